//! Long edges of the place that show how the lens bends lines: kerbs, roofs, markings, masts.
//!
//! Edge points to a fraction of a pixel (Canny's maxima across the edge, with a parabola through them: Devernay 1995) are followed
//! along the edge; the chains are cut until each piece is a parabola. What a piece tells is how far its middle is from its ends'
//! line.

use image::RgbImage;
use nalgebra::{Matrix3, Vector2, Vector3};
use opencv::core::{CV_32F, Mat, MatTraitConstManual as _, Size, Vec3b};
use opencv::imgproc::{COLOR_RGB2GRAY, cvt_color_def, gaussian_blur_def, sobel};
use roadplane_base::SceneCurve;

use crate::WatchError;
use crate::lines::is_in;

/// Smoothing before edges are found, px (sd).
const BLUR_PX: f64 = 1.2;
/// Grey levels a pixel that an edge changes by at least, …
const LEAST_CHANGE: f32 = 2.0;
/// … and this share of what a fifth of the picture exceeds.
const CHANGE_SHARE: f32 = 0.6;
/// From point to point an edge turns by less than this (cosine).
const TURN: f32 = 0.9;
/// Shortest piece, as a share of the picture's width, and points.
const MIN_SHARE: f64 = 0.04;
const MIN_POINTS: usize = 40;
/// Points are off their parabola by less than this, px: rms, and each.
const RMS_PX: f64 = 0.6;
const MOST_PX: f64 = 2.4;
/// The middle is off the ends' line by no more than this share of their distance: what bends more is no straight thing.
const MOST_BEND: f64 = 0.04;
/// So many neighbouring points share their error.
const SHARED_POINTS: f64 = 8.0;
/// How well the middle is found beside the scatter of points, px.
const FLOOR_PX: f64 = 0.1;
/// Edges nearer to the rim than this share of the width may be the rim's own; those along the picture's rows and columns to this
/// angle, rad, may be drawn into it.
const RIM_SHARE: f64 = 0.008;
const DRAWN_RAD: f64 = 0.0015;
/// At most so many are kept, the longest first, and of those within [`CROWD_SHARE`] of the width so many.
const MOST: usize = 150;
const CROWD: usize = 2;
const CROWD_SHARE: f64 = 0.025;

/// Long edges in a picture, the longest first, none in `boxes` (left, top, right, bottom, px), where vehicles are.
///
/// # Errors
/// [`WatchError`] when OpenCV fails.
pub fn scene_curves(image: &RgbImage, boxes: &[[f64; 4]]) -> Result<Vec<SceneCurve>, WatchError> {
    let width = f64::from(image.width());
    let least = ((MIN_SHARE * width) as usize).max(MIN_POINTS);
    let points = EdgePoints::of(image)?;
    let mut pieces: Vec<SceneCurve> =
        points.chains(least).into_iter().flat_map(|chain| pieces(&chain, least)).collect();
    pieces.retain(|curve| {
        let [a, _, c] = curve.points_px;
        ((c - a) / (c - a).norm()).abs().min() > DRAWN_RAD
            && !boxes.iter().any(|b| curve.points_px.iter().any(|p| is_in(b, p)))
    });
    let length = |curve: &SceneCurve| (curve.points_px[2] - curve.points_px[0]).norm();
    pieces.sort_by(|a, b| length(b).total_cmp(&length(a)));
    let mut kept: Vec<SceneCurve> = Vec::new();
    for curve in pieces {
        let near =
            |other: &&SceneCurve| (other.points_px[1] - curve.points_px[1]).norm() < CROWD_SHARE * width;
        if kept.len() < MOST && kept.iter().filter(near).count() < CROWD {
            kept.push(curve.rounded());
        }
    }
    Ok(kept)
}

/// Points of steepest change, by pixel.
struct EdgePoints {
    width: usize,
    /// Place in `points` + 1 of the point in each pixel, 0 for none.
    at_pixel: Vec<u32>,
    points: Vec<EdgePoint>,
}

#[derive(Clone, Copy)]
struct EdgePoint {
    pixel: usize,
    at: Vector2<f64>,
    /// Unit, from dark to light.
    across: Vector2<f32>,
    change: f32,
}

impl EdgePoints {
    fn of(image: &RgbImage) -> Result<Self, WatchError> {
        let side = |length: u32| i32::try_from(length).unwrap_or(i32::MAX);
        let pixels = Mat::new_rows_cols_with_bytes::<Vec3b>(
            side(image.height()),
            side(image.width()),
            image.as_raw(),
        )?;
        let (mut grey, mut blurred) = (Mat::default(), Mat::default());
        cvt_color_def(&pixels, &mut grey, COLOR_RGB2GRAY)?;
        gaussian_blur_def(&grey, &mut blurred, Size::new(0, 0), BLUR_PX)?;
        let slope = |dx: i32, dy: i32| -> Result<Vec<f32>, WatchError> {
            let mut slope = Mat::default();
            sobel(&blurred, &mut slope, CV_32F, dx, dy, 3, 0.125, 0.0, opencv::core::BORDER_DEFAULT)?;
            Ok(slope.data_typed::<f32>()?.to_vec())
        };
        let (by_x, by_y) = (slope(1, 0)?, slope(0, 1)?);
        let change: Vec<f32> = by_x.iter().zip(&by_y).map(|(x, y)| x.hypot(*y)).collect();
        let (width, height) = (image.width() as usize, image.height() as usize);
        let mut found = Self { width, at_pixel: vec![0; width * height], points: Vec::new() };
        let mut sorted = change.clone();
        let fifth = sorted.len() * 4 / 5;
        let Some((_, exceeded, _)) =
            (fifth < sorted.len()).then(|| sorted.select_nth_unstable_by(fifth, f32::total_cmp))
        else {
            return Ok(found);
        };
        let least = LEAST_CHANGE.max(CHANGE_SHARE * *exceeded);
        // Bilinear, as the neighbours across the edge lie between pixels.
        let between = |x: f32, y: f32| {
            let (column, row) = (x as usize, y as usize);
            let (right, low) = (x - column as f32, y - row as f32);
            let value = |dx: usize, dy: usize| change[(row + dy) * width + column + dx];
            (value(0, 0) * (1.0 - right) + value(1, 0) * right) * (1.0 - low)
                + (value(0, 1) * (1.0 - right) + value(1, 1) * right) * low
        };
        // At least the step to the neighbours across an edge.
        let rim = ((RIM_SHARE * width as f64) as usize).max(3);
        for row in rim..height.saturating_sub(rim) {
            for column in rim..width.saturating_sub(rim) {
                let pixel = row * width + column;
                let here = change[pixel];
                if here <= least {
                    continue;
                }
                let across = Vector2::new(by_x[pixel], by_y[pixel]) / here;
                let (x, y) = (column as f32, row as f32);
                let (before, after) =
                    (between(x - across.x, y - across.y), between(x + across.x, y + across.y));
                if here < before || here <= after {
                    continue;
                }
                let off = 0.5 * (before - after) / (before - 2.0 * here + after - 1e-9);
                let at = Vector2::new(x + off * across.x, y + off * across.y).cast();
                found.points.push(EdgePoint { pixel, at, across, change: here });
                found.at_pixel[pixel] = u32::try_from(found.points.len()).unwrap_or(0);
            }
        }
        Ok(found)
    }

    /// Chains of points along edges, of at least so many, from strong to weak.
    fn chains(&self, least: usize) -> Vec<Vec<Vector2<f64>>> {
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        order.sort_by(|a, b| self.points[*b].change.total_cmp(&self.points[*a].change).then(a.cmp(b)));
        let mut taken = vec![false; self.points.len()];
        let mut chains = Vec::new();
        for start in order {
            if std::mem::replace(&mut taken[start], true) {
                continue;
            }
            let ahead = self.followed(start, 1.0, &mut taken);
            let mut chain = self.followed(start, -1.0, &mut taken);
            chain.reverse();
            chain.push(start);
            chain.extend(ahead);
            if chain.len() >= least {
                chains.push(chain.into_iter().map(|i| self.points[i].at).collect());
            }
        }
        chains
    }

    /// Points that follow one along its edge, in one sense.
    fn followed(&self, start: usize, sense: f32, taken: &mut [bool]) -> Vec<usize> {
        let mut path = Vec::new();
        let mut current = start;
        while let Some(next) = self.next(current, sense, taken) {
            taken[next] = true;
            path.push(next);
            current = next;
        }
        path
    }

    fn next(&self, current: usize, sense: f32, taken: &[bool]) -> Option<usize> {
        let here = &self.points[current];
        let along = Vector2::new(-here.across.y, here.across.x) * sense;
        let mut best: Option<(usize, f32)> = None;
        for (dx, dy) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
            // Points keep away from the rim, so that neighbours are in the picture.
            let pixel = here.pixel.wrapping_add_signed(dy * self.width.cast_signed() + dx);
            let found = self.at_pixel.get(pixel).copied().unwrap_or(0) as usize;
            let Some(there) = found.checked_sub(1).filter(|there| !taken[*there]) else { continue };
            let step = Vector2::new(dx as f32, dy as f32);
            let step = step / step.norm();
            let (onward, alike) = (along.dot(&step), here.across.dot(&self.points[there].across));
            if onward > 0.5 && alike > TURN {
                let strength = (self.points[there].change / here.change).min(1.0);
                let merit = onward + alike + 0.2 * strength;
                if best.is_none_or(|(_, most)| merit > most) {
                    best = Some((there, merit));
                }
            }
        }
        best.map(|(there, _)| there)
    }
}

/// Cuts a chain until its pieces are parabolas; what is too short or bends too much is dropped.
fn pieces(chain: &[Vector2<f64>], least: usize) -> Vec<SceneCurve> {
    let mut open = vec![chain];
    let mut found = Vec::new();
    while let Some(points) = open.pop() {
        if points.len() < least {
            continue;
        }
        match parabola(points) {
            Fit::Good(curve) => found.extend(curve),
            Fit::CutAt(at) => {
                let at = at.clamp(points.len() / 4, 3 * points.len() / 4);
                open.extend([&points[..at], &points[at..]]);
            }
        }
    }
    found
}

enum Fit {
    /// A parabola, told unless it bends too much.
    Good(Option<SceneCurve>),
    /// None: it had better be cut here.
    CutAt(usize),
}

/// Lays a parabola through points, in the frame of their ends' line.
fn parabola(points: &[Vector2<f64>]) -> Fit {
    let (first, last) = (points[0], points[points.len() - 1]);
    let length = (last - first).norm();
    // A chain that comes back to where it began.
    if length < 0.5 * points.len() as f64 {
        return Fit::CutAt(points.len() / 2);
    }
    let along = (last - first) / length;
    let across = Vector2::new(-along.y, along.x);
    let row = |t: f64| Vector3::new(1.0, t, t * t);
    let place = |point: &Vector2<f64>| {
        let from = point - first;
        (along.dot(&from) / length - 0.5, across.dot(&from))
    };
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (t, off) in points.iter().map(place) {
        normal += row(t) * row(t).transpose();
        right += off * row(t);
    }
    let Some(solved) = normal.cholesky().map(|normal| normal.solve(&right)) else {
        return Fit::CutAt(points.len() / 2);
    };
    let residuals: Vec<f64> =
        points.iter().map(place).map(|(t, off)| (off - solved.dot(&row(t))).abs()).collect();
    let rms = (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt();
    let worst = (0..residuals.len()).max_by(|a, b| residuals[*a].total_cmp(&residuals[*b])).unwrap_or(0);
    if rms > RMS_PX || residuals[worst] > MOST_PX {
        return Fit::CutAt(worst);
    }
    let at = |t: f64| first + along * ((t + 0.5) * length) + across * solved.dot(&row(t));
    let independent = (points.len() as f64 / SHARED_POINTS).max(3.0);
    // The middle of a parabola is a quarter of its square term off its ends' line, which n points along it tell to √(180 / n) sds.
    let sd_px = (rms * 180_f64.sqrt() / (4.0 * independent.sqrt())).hypot(FLOOR_PX);
    let is_gentle = 0.25 * solved.z.abs() < MOST_BEND * length;
    Fit::Good(is_gentle.then(|| SceneCurve { points_px: [at(-0.5), at(0.0), at(0.5)], sd_px }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{ImageSize, Lens};

    const SIZE: ImageSize = ImageSize { width: 960, height: 540 };

    /// A dark band along a line of the scene, as a lens shows it.
    fn drawn(lens: Lens, from: Vector2<f64>, to: Vector2<f64>) -> RgbImage {
        let along = (to - from) / (to - from).norm();
        RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| {
            let bent = Vector2::new(f64::from(x), f64::from(y)) - SIZE.centre_px();
            let off = along.perp(&(lens.straightened(&bent) - from)).abs();
            let noise = f64::from((x.wrapping_mul(7919) ^ y.wrapping_mul(104_729)) % 7) - 3.0;
            let v = (160.0 - 80.0 * (6.5 - off).clamp(0.0, 1.0) + noise).round() as u8;
            image::Rgb([v, v, v])
        })
    }

    #[test]
    fn both_sides_of_a_line_show_the_lens() {
        let (from, to) = (Vector2::new(-420.0, -190.0), Vector2::new(430.0, -160.0));
        for bend in [0.0, -0.12] {
            let lens = Lens::with_bend(bend, SIZE);
            let found = scene_curves(&drawn(lens, from, to), &[]).unwrap();
            assert!(found.len() >= 2, "{bend}: {found:?}");
            for curve in &found {
                let [a, b, c] = curve.points_px.map(|p| lens.straightened(&(p - SIZE.centre_px())));
                let off = (c - a).perp(&(b - a)) / (c - a).norm();
                assert!(off.abs() < 0.3, "{bend}: the middle of {curve:?} is {off} px off");
                let bent = curve.points_px[1] - curve.points_px[0];
                let chord = curve.points_px[2] - curve.points_px[0];
                let is_long = chord.norm() > 700.0;
                assert!(bend == 0.0 || !is_long || chord.perp(&bent).abs() > 10.0 * chord.norm());
            }
        }
    }

    #[test]
    fn circles_vehicles_and_small_pictures_tell_nothing() {
        let ring = RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| {
            let from = Vector2::new(f64::from(x), f64::from(y)) - SIZE.centre_px();
            image::Rgb([if (from.norm() - 150.0).abs() < 6.0 { 60 } else { 160 }; 3])
        });
        let found = scene_curves(&ring, &[]).unwrap();
        // Pieces of a circle are seen as bent lines, none as straight.
        for curve in &found {
            let [a, b, c] = curve.points_px;
            assert!((c - a).perp(&(b - a)).abs() > 3.0 * curve.sd_px * (c - a).norm(), "{curve:?}");
        }
        let line = drawn(Lens::STRAIGHT, Vector2::new(-420.0, -190.0), Vector2::new(430.0, -160.0));
        assert!(scene_curves(&line, &[[0.0, 50.0, 960.0, 150.0]]).unwrap().is_empty());
        assert!(scene_curves(&RgbImage::new(3, 2), &[]).unwrap().is_empty());
    }
}
