//! Long edges of the scene that show the lens's distortion: kerbs, roofs, markings, masts.
//!
//! Edge points are located to a fraction of a pixel. They are Canny's maxima across the edge, refined by a parabola
//! (Devernay 1995). Points along an edge are linked to a chain. Each chain is cut until every piece fits a parabola.
//! The measurement of a piece is the distance between its middle and the line through its ends.

use image::RgbImage;
use nalgebra::{Matrix3, Vector2, Vector3};
use opencv::core::{CV_32F, Mat, MatTraitConstManual as _, Size, Vec3b};
use opencv::imgproc::{COLOR_RGB2GRAY, cvt_color_def, gaussian_blur_def, sobel};
use roadplane_base::SceneCurve;

use crate::WatchError;
use crate::lines::is_in;

/// Standard deviation of the Gaussian blur before edges are located, px.
const BLUR_PX: f64 = 1.2;
/// Smallest gradient across an edge, grey levels per pixel.
const LEAST_CHANGE: f32 = 2.0;
/// Smallest gradient across an edge, as a share of the 80th percentile of the picture's gradients.
const CHANGE_SHARE: f32 = 0.6;
/// Cosine of the largest turn of an edge from one point to the next.
const TURN: f32 = 0.9;
/// Smallest number of points of a piece, as a share of the picture's width in px.
const MIN_SHARE: f64 = 0.04;
/// Smallest number of points of a piece, whatever the picture's width.
const MIN_POINTS: usize = 40;
/// Largest rms distance between the points of a piece and the fitted parabola, px.
const RMS_PX: f64 = 0.6;
/// Largest distance between any point of a piece and the fitted parabola, px.
const MOST_PX: f64 = 2.4;
/// Largest distance between a piece's middle and the line through its ends, as a share of the distance between the
/// ends. An edge that curves more is not straight in the world.
const MAX_SAGITTA: f64 = 0.04;
/// Number of neighbouring points that have the same error.
const SHARED_POINTS: f64 = 8.0;
/// Additional error of a piece's middle that the scatter of its points does not show, px (sd).
const FLOOR_PX: f64 = 0.1;
/// Margin at the picture's border, as a share of the picture's width. An edge within this margin may be the border
/// itself.
const RIM_SHARE: f64 = 0.008;
/// Smallest angle between an edge and the picture's rows or columns, rad. An edge along a row or column may belong to
/// an overlay.
const DRAWN_RAD: f64 = 0.0015;
/// Largest number of edges that are kept, the longest first.
const MOST: usize = 150;
/// Largest number of neighbouring edges that are kept.
const CROWD: usize = 2;
/// Distance below which two edges are neighbours, as a share of the picture's width.
const CROWD_SHARE: f64 = 0.025;

/// Finds long edges in a picture, the longest first.
///
/// `boxes` are the boxes of vehicles: left, top, right, bottom, px. Edges in a box are left out.
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

/// Points of steepest change in a picture, indexed by pixel.
struct EdgePoints {
    width: usize,
    /// For each pixel, 1 plus the index of its point in `points`; 0 if the pixel has no point.
    at_pixel: Vec<u32>,
    points: Vec<EdgePoint>,
}

#[derive(Clone, Copy)]
struct EdgePoint {
    pixel: usize,
    at: Vector2<f64>,
    /// Unit vector across the edge, from dark to light.
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
        // The neighbours across the edge lie between pixels, so their values are interpolated bilinearly.
        let between = |x: f32, y: f32| {
            let (column, row) = (x as usize, y as usize);
            let (right, low) = (x - column as f32, y - row as f32);
            let value = |dx: usize, dy: usize| change[(row + dy) * width + column + dx];
            (value(0, 0) * (1.0 - right) + value(1, 0) * right) * (1.0 - low)
                + (value(0, 1) * (1.0 - right) + value(1, 1) * right) * low
        };
        // With a margin of at least 3 px, the neighbours across an edge lie inside the picture.
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

    /// Links the points along edges to chains of at least `least` points. The strongest points start the first chains.
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

    /// Follows an edge from one point in one direction (`sense` 1 or −1). Returns the indices of the points on the way.
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
            // No point lies at the picture's border, so all its neighbours are inside the picture.
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

/// Cuts a chain until every piece fits a parabola. Drops pieces that are too short or curve too much.
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
    /// The points fit a parabola. The value is `None` if the parabola curves too much for a straight object.
    Good(Option<SceneCurve>),
    /// The points do not fit a parabola. The value is the index at which they should be cut.
    CutAt(usize),
}

/// Fits a parabola to points. Its axes are the line through the first and the last point, and the direction across this
/// line.
fn parabola(points: &[Vector2<f64>]) -> Fit {
    let (first, last) = (points[0], points[points.len() - 1]);
    let length = (last - first).norm();
    // A chain with its ends this close curves back, so it is cut in half.
    if length < 0.5 * points.len() as f64 {
        return Fit::CutAt(points.len() / 2);
    }
    let along = (last - first) / length;
    let across = Vector2::new(-along.y, along.x);
    let row = |t: f64| Vector3::new(1.0, t, t * t);
    let position = |point: &Vector2<f64>| {
        let from = point - first;
        (along.dot(&from) / length - 0.5, across.dot(&from))
    };
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (t, off) in points.iter().map(position) {
        normal += row(t) * row(t).transpose();
        right += off * row(t);
    }
    let Some(solved) = normal.cholesky().map(|normal| normal.solve(&right)) else {
        return Fit::CutAt(points.len() / 2);
    };
    let residuals: Vec<f64> =
        points.iter().map(position).map(|(t, off)| (off - solved.dot(&row(t))).abs()).collect();
    let rms = (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt();
    let worst = (0..residuals.len()).max_by(|a, b| residuals[*a].total_cmp(&residuals[*b])).unwrap_or(0);
    if rms > RMS_PX || residuals[worst] > MOST_PX {
        return Fit::CutAt(worst);
    }
    let at = |t: f64| first + along * ((t + 0.5) * length) + across * solved.dot(&row(t));
    let independent = (points.len() as f64 / SHARED_POINTS).max(3.0);
    // Along the chain, t runs from −0.5 to 0.5. The square term z puts the parabola's middle z / 4 off the line through
    // its ends. The sd of z is rms · √(180 / n), for n independent points with this rms scatter.
    let sd_px = (rms * 180_f64.sqrt() / (4.0 * independent.sqrt())).hypot(FLOOR_PX);
    let is_gentle = 0.25 * solved.z.abs() < MAX_SAGITTA * length;
    Fit::Good(is_gentle.then(|| SceneCurve { points_px: [at(-0.5), at(0.0), at(0.5)], sd_px }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{ImageSize, Lens};

    const SIZE: ImageSize = ImageSize { width: 960, height: 540 };

    /// Draws a dark band along a straight line of the scene, as seen through a distorting lens.
    fn drawn(lens: Lens, from: Vector2<f64>, to: Vector2<f64>) -> RgbImage {
        let along = (to - from) / (to - from).norm();
        RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| {
            let distorted = Vector2::new(f64::from(x), f64::from(y)) - SIZE.centre_px();
            let off = along.perp(&(lens.undistorted(&distorted) - from)).abs();
            let noise = f64::from((x.wrapping_mul(7919) ^ y.wrapping_mul(104_729)) % 7) - 3.0;
            let v = (160.0 - 80.0 * (6.5 - off).clamp(0.0, 1.0) + noise).round() as u8;
            image::Rgb([v, v, v])
        })
    }

    #[test]
    fn both_sides_of_a_line_show_the_lens() {
        let (from, to) = (Vector2::new(-420.0, -190.0), Vector2::new(430.0, -160.0));
        for distortion in [0.0, -0.12] {
            let lens = Lens::with_distortion(distortion, SIZE);
            let found = scene_curves(&drawn(lens, from, to), &[]).unwrap();
            assert!(found.len() >= 2, "{distortion}: {found:?}");
            for curve in &found {
                let [a, b, c] = curve.points_px.map(|p| lens.undistorted(&(p - SIZE.centre_px())));
                let off = (c - a).perp(&(b - a)) / (c - a).norm();
                assert!(off.abs() < 0.3, "{distortion}: the middle of {curve:?} is {off} px off");
                let middle = curve.points_px[1] - curve.points_px[0];
                let chord = curve.points_px[2] - curve.points_px[0];
                let is_long = chord.norm() > 700.0;
                assert!(distortion == 0.0 || !is_long || chord.perp(&middle).abs() > 10.0 * chord.norm());
            }
        }
    }

    #[test]
    fn circles_vehicles_and_small_pictures_give_no_straight_edges() {
        let ring = RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| {
            let from = Vector2::new(f64::from(x), f64::from(y)) - SIZE.centre_px();
            image::Rgb([if (from.norm() - 150.0).abs() < 6.0 { 60 } else { 160 }; 3])
        });
        let found = scene_curves(&ring, &[]).unwrap();
        // Pieces of a circle are found as curved lines, never as straight ones.
        for curve in &found {
            let [a, b, c] = curve.points_px;
            assert!((c - a).perp(&(b - a)).abs() > 3.0 * curve.sd_px * (c - a).norm(), "{curve:?}");
        }
        let line = drawn(Lens::STRAIGHT, Vector2::new(-420.0, -190.0), Vector2::new(430.0, -160.0));
        assert!(scene_curves(&line, &[[0.0, 50.0, 960.0, 150.0]]).unwrap().is_empty());
        assert!(scene_curves(&RgbImage::new(3, 2), &[]).unwrap().is_empty());
    }
}
