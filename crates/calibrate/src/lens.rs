//! How the lens bends lines, by long edges of the scene (plumb-line: Brown 1971; by single edges and a search over the bend, as
//! Alemán-Flores et al., IPOL 2014).
//!
//! Most long edges of streets and houses are straight, some are bent, and nobody says which. Before the right lens the middle of a
//! straight one is on its ends' line, up to `sd_px` and a fraction of a pixel, as nothing is quite straight; a bent one's is off by
//! anything of a few pixels, to either side. The share of straight ones, and how straight they are, is not known. So each edge is a
//! mixture, and the bend's likelihood follows on a grid.
//!
//! Beforehand a picture is straight (a good lens, or straightened by the camera) or bent as surveillance lenses bend it: in
//! proportion to how wide the picture is against the focal length. The lens counts only where it explains the edges a hundred times
//! better than a straight one (a Bayes factor), and where no side of the picture is alone in saying so; otherwise the picture is
//! taken for straight. What then is not known of the bend is an error that all cars share.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use roadplane_base::{ImageSize, Lens, SceneCurve};

/// No more edges are looked at; ours are fewer, others' files may have any number.
const MOST_CURVES: usize = 300;
/// Log of how many times better than without a bend the edges must be explained: a hundred times.
const LEAST_GAIN: f64 = 4.6;
/// Sides: right, down, left, up.
const SIDES: usize = 4;
/// Shares of straight edges, and how far the middle of these is off, px (sd), that are weighed, evenly.
const SHARES: [f64; 4] = [0.1, 0.25, 0.5, 0.75];
const CROOKED_PX: [f64; 3] = [0.15, 0.3, 0.6];
/// All pairs of these.
const KINDS: usize = SHARES.len() * CROOKED_PX.len();
/// The middle of an edge that is not straight is off by this on average, as a share of the picture's width.
const STRAY_SHARE: f64 = 0.0035;
/// The bends that are looked at, and how far apart.
const BENDS: [f64; 2] = [-0.6, 0.2];
const STEP: f64 = 0.0025;
/// Share of pictures that are straight, and sd of the bend that these have nevertheless.
const STRAIGHT_SHARE: f64 = 0.4;
pub(crate) const STRAIGHT_SD: f64 = 0.005;
/// OpenCV's k1 of the others' lenses, mean and sd: most bend lines outwards, published ones by −0.4 to 0.05.
const K1: [f64; 2] = [-0.12, 0.15];
/// And the greatest of them.
const GREATEST_K1: f64 = 0.05;

/// What the edges of a place say of the lens.
#[derive(Clone, Debug, PartialEq)]
pub struct LensView {
    size: ImageSize,
    /// No edges.
    is_bare: bool,
    /// Log likelihood of the edges of each side, for each of [`KINDS`], over [`bends`].
    sides: [[Vec<f64>; KINDS]; SIDES],
}

/// The lens, and how sure that is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensFound {
    /// The lens.
    pub lens: Lens,
    /// sd of its bend ([`Lens::bend`]).
    pub bend_sd: f64,
    /// Log of how many times better than a straight one it explains the edges.
    pub gain: f64,
}

/// What is known of the focal length before the lens: mean and sd of its logarithm, px.
pub type LogFocal = [f64; 2];

impl LensView {
    /// Of long edges of a place.
    #[must_use]
    pub fn of(curves: &[SceneCurve], size: ImageSize) -> Self {
        let curves = &curves[..curves.len().min(MOST_CURVES)];
        let stray_px = STRAY_SHARE * f64::from(size.width);
        let mut sides = std::array::from_fn(|_| std::array::from_fn(|_| vec![0.0; bends().count()]));
        for curve in curves.iter().filter(|curve| curve.is_sound()) {
            let side: &mut [Vec<f64>; KINDS] = &mut sides[side_of(curve, size)];
            for (i, bend) in bends().enumerate() {
                let off_px = off_line(curve, Lens::with_bend(bend, size), size);
                let stray = (-off_px.abs() / stray_px).exp() / (2.0 * stray_px);
                let straight = CROOKED_PX.map(|crooked_px| {
                    let sd_px = curve.sd_px.hypot(crooked_px);
                    normal(off_px / sd_px) / (sd_px * TAU.sqrt())
                });
                let kinds = SHARES.iter().flat_map(|share| straight.iter().map(move |there| (share, there)));
                for (logs, (share, straight)) in side.iter_mut().zip(kinds) {
                    logs[i] += (share * straight + (1.0 - share) * stray).max(f64::MIN_POSITIVE).ln();
                }
            }
        }
        Self { size, is_bare: curves.is_empty(), sides }
    }

    /// Log likelihood over [`bends`] of the edges of all sides but one.
    fn logs(&self, but: Option<usize>) -> Vec<f64> {
        let sides = || (0..SIDES).filter(|side| but != Some(*side)).map(|side| &self.sides[side]);
        let of_kind = |i: usize, kind: usize| sides().map(|side| side[kind][i]).sum::<f64>();
        (0..bends().count()).map(|i| log_sum((0..KINDS).map(|kind| of_kind(i, kind)))).collect()
    }

    /// The lens, where the edges show one, before the cars are looked at.
    #[must_use]
    pub fn found(&self, log_focal: LogFocal) -> Option<LensFound> {
        if self.is_bare {
            return None;
        }
        let bent = self.prior(log_focal, 0.0);
        let straight = self.prior(log_focal, 1.0);
        let gain = |but: Option<usize>| {
            let logs = self.logs(but);
            let explained =
                |prior: &[f64]| log_sum(logs.iter().zip(prior).map(|(log, prior)| log + prior.ln()));
            explained(&bent) - explained(&straight)
        };
        let [mean, sd] = self.moments(&bent)?;
        // Kerbs and markings of a road that curves are all bent alike, and lie on one side of the picture; a lens bends those of the
        // other side the other way. So the edges without those of any one side must not speak against it.
        let of_rest = (0..SIDES).map(|side| gain(Some(side))).fold(f64::INFINITY, f64::min);
        let gain = gain(None);
        (gain > LEAST_GAIN && of_rest > 0.0).then(|| LensFound {
            lens: Lens::with_bend(mean, self.size),
            bend_sd: sd,
            gain,
        })
    }

    /// How far the bend may be from what it is taken for (sd), when the focal length is known.
    #[must_use]
    pub fn sd_about(&self, lens: Lens, log_focal: LogFocal) -> f64 {
        let prior = self.prior(log_focal, STRAIGHT_SHARE);
        self.moments(&prior).map_or(0.0, |[mean, sd]| (mean - lens.bend(self.size)).hypot(sd))
    }

    /// Density of each bend beforehand, over what the focal length may be.
    fn prior(&self, [log_focal, sd]: LogFocal, straight_share: f64) -> Vec<f64> {
        const STEPS: i32 = 10;
        let mut prior = vec![0.0; bends().count()];
        for step in -STEPS..=STEPS {
            let z = 2.5 * f64::from(step) / f64::from(STEPS);
            let [mean, sd] = bend_of_lenses((log_focal + z * sd).exp(), self.size);
            let weight = (-0.5 * z * z).exp();
            for (density, bend) in prior.iter_mut().zip(bends()) {
                let bent = normal((bend - mean) / sd) / sd;
                let straight = normal(bend / STRAIGHT_SD) / STRAIGHT_SD;
                *density += weight * ((1.0 - straight_share) * bent + straight_share * straight);
            }
        }
        let sum: f64 = prior.iter().sum();
        prior.iter().map(|density| (density / sum).max(f64::MIN_POSITIVE)).collect()
    }

    /// Mean and sd of the bend.
    fn moments(&self, prior: &[f64]) -> Option<[f64; 2]> {
        let logs = self.logs(None);
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> =
            logs.iter().zip(prior).map(|(log, prior)| (log - most).exp() * prior).collect();
        let sum: f64 = weights.iter().sum();
        let mean = bends().zip(&weights).map(|(bend, weight)| bend * weight).sum::<f64>() / sum;
        let variance =
            bends().zip(&weights).map(|(bend, weight)| (bend - mean).powi(2) * weight).sum::<f64>() / sum;
        (mean.is_finite() && variance.is_finite()).then(|| [mean, variance.sqrt().max(STEP)])
    }
}

/// What a k1 of 1 bends lines by, for lenses of a focal length, px.
fn bend_of_one(focal_px: f64, size: ImageSize) -> f64 {
    (0.5 * f64::from(size.width) / focal_px).powi(2)
}

/// Bend of the lens of a focal length, px, that bends lines inwards most.
pub(crate) fn greatest_bend(focal_px: f64, size: ImageSize) -> f64 {
    GREATEST_K1 * bend_of_one(focal_px, size)
}

/// Mean and sd of the bend of lenses of a focal length, px, where pictures were not straightened.
pub(crate) fn bend_of_lenses(focal_px: f64, size: ImageSize) -> [f64; 2] {
    let wide = bend_of_one(focal_px, size);
    [K1[0] * wide, (K1[1] * wide).hypot(STRAIGHT_SD)]
}

fn bends() -> impl Iterator<Item = f64> {
    let count = ((BENDS[1] - BENDS[0]) / STEP).round() as usize;
    (0..=count).map(|i| BENDS[0] + STEP * i as f64)
}

/// On which side of the picture an edge's line passes the middle.
fn side_of(curve: &SceneCurve, size: ImageSize) -> usize {
    let [a, _, c] = curve.points_px.map(|point| point - size.centre_px());
    let along = (c - a) / (c - a).norm();
    let foot = a - along * along.dot(&a);
    match (foot.x.abs() > foot.y.abs(), foot.x > 0.0, foot.y > 0.0) {
        (true, true, _) => 0,
        (false, _, true) => 1,
        (true, false, _) => 2,
        (false, _, false) => 3,
    }
}

/// How far an edge's middle is off its ends' line before a lens that bends no lines, px as the picture has them there.
fn off_line(curve: &SceneCurve, lens: Lens, size: ImageSize) -> f64 {
    let from_centre: [Vector2<f64>; 3] = curve.points_px.map(|point| point - size.centre_px());
    let [a, b, c] = from_centre.map(|point| lens.straightened(&point));
    let stretched = (c - a).norm() / (from_centre[2] - from_centre[0]).norm();
    (c - a).perp(&(b - a)) / ((c - a).norm() * stretched)
}

fn normal(z: f64) -> f64 {
    (-0.5 * z * z).exp()
}

/// Log of the sum of exponentials.
fn log_sum(logs: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = logs.clone().fold(f64::NEG_INFINITY, f64::max);
    most + logs.map(|log| (log - most).exp()).sum::<f64>().ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: ImageSize = ImageSize { width: 1920, height: 1080 };
    /// What the solver takes for granted of cameras.
    const ANY: LogFocal = [7.742, 0.6];

    /// Edges all over the picture, every third one of a bent thing, as a lens shows them.
    fn curves(bend: f64, count: u32) -> Vec<SceneCurve> {
        let lens = Lens::with_bend(bend, SIZE);
        let spread = |i: u32, k: u32| f64::from(i.wrapping_mul(k) % 97) / 97.0 - 0.5;
        let curve = |i: u32| {
            let middle = Vector2::new(1600.0 * spread(i, 37), 900.0 * spread(i, 53));
            let angle = 3.1 * spread(i, 71);
            let along = Vector2::new(angle.cos(), angle.sin()) * (100.0 + 150.0 * (spread(i, 29) + 0.5));
            let across = Vector2::new(-angle.sin(), angle.cos());
            let found = 0.6 * spread(i, 13) + if i.is_multiple_of(3) { 20.0 * spread(i, 17) } else { 0.0 };
            let ends = [middle - along, middle + along];
            let points = [ends[0], middle + found * across, ends[1]];
            SceneCurve { points_px: points.map(|p| lens.bent(&p) + SIZE.centre_px()), sd_px: 0.5 }
        };
        (0..count).map(curve).collect()
    }

    #[test]
    fn the_lens_is_found_among_bent_things() {
        for bend in [-0.25, -0.15, -0.05] {
            let found = LensView::of(&curves(bend, 90), SIZE).found(ANY).unwrap();
            let off = found.lens.bend(SIZE) - bend;
            assert!(off.abs() < 3.0 * found.bend_sd && found.bend_sd < 0.01, "{bend}: {found:?}");
        }
    }

    #[test]
    fn straight_pictures_and_bare_ones_stay_straight() {
        assert_eq!(LensView::of(&curves(0.0, 90), SIZE).found(ANY), None);
        assert_eq!(LensView::of(&curves(-0.05, 3), SIZE).found(ANY), None);
        assert_eq!(LensView::of(&[], SIZE).found(ANY), None);
    }

    #[test]
    fn a_road_that_curves_is_no_lens() {
        // Lanes to the left of the middle, all bent alike.
        let lane = |i: i32| {
            let x = 150.0 + 40.0 * f64::from(i);
            let points = [[x + 300.0, 100.0], [x + 138.0, 500.0], [x, 900.0]].map(Vector2::from);
            SceneCurve { points_px: points, sd_px: 0.5 }
        };
        let lanes: Vec<SceneCurve> = (0..8).map(lane).collect();
        let with_houses = [&lanes[..], &curves(0.0, 20)].concat();
        assert_eq!(LensView::of(&lanes, SIZE).found(ANY), None);
        assert_eq!(LensView::of(&with_houses, SIZE).found(ANY), None);
    }

    #[test]
    fn what_is_not_known_of_the_lens_depends_on_the_focal_length() {
        let bare = LensView::of(&[], SIZE);
        let sd = |focal_px: f64| bare.sd_about(Lens::STRAIGHT, [focal_px.ln(), 0.05]);
        assert!(sd(5000.0) < 0.01 && sd(1000.0) > 0.08, "{} {}", sd(5000.0), sd(1000.0));
        let seen = LensView::of(&curves(0.0, 90), SIZE);
        assert!(seen.sd_about(Lens::STRAIGHT, [1000_f64.ln(), 0.05]) < 0.006);
    }
}
