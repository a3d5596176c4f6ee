//! Estimates the lens distortion from long edges of the scene, and from the turns of the camera.
//!
//! Edges: this is the plumb-line method (Brown 1971). The use of single edges and the search over the distortion follow
//! Alemán-Flores et al. (IPOL 2014).
//!
//! Most long edges of streets and houses are straight, some are curved, and no label says which. Once the correct
//! distortion is removed, a straight edge's midpoint lies on the line through its ends. It is off by `sd_px` and a
//! fraction of a pixel, because nothing is quite straight. The midpoint of a curved edge is off by several pixels, to
//! either side. The share of straight edges, and their straightness, are unknown. So each edge is a mixture, and the
//! likelihood of the distortion is computed on a grid.
//!
//! As a prior, half of all pictures are free of distortion: they have a good lens, or the camera corrects them. The others
//! are distorted as surveillance lenses distort them. This distortion grows with the picture's width relative to the focal
//! length.
//!
//! Turns: pictures of a camera that turns fit each other only through the right lens ([`TurnedLens`]). They count as
//! one measurement of the distortion. If it is more accurate than the assumption of no distortion, the lens is the
//! posterior mean of both.
//!
//! If not, a lens is used under two conditions. It explains the edges a hundred times better than no distortion (a Bayes
//! factor), and no side of the picture is the only one in favour of it. In all other cases the picture counts as free of
//! distortion. The remaining uncertainty of the distortion is an error that all cars share.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use roadplane_base::{ImageSize, Lens, SceneCurve};

use crate::turned_lens::TurnedLens;

/// Largest number of edges that are used. This program's record files have fewer edges; those of other programs may
/// have any number.
pub(crate) const MOST_EDGES: usize = 300;
/// Least log Bayes factor of a distortion, or of vertical edges, over chance: a hundred times.
pub(crate) const LEAST_GAIN: f64 = 4.6;
/// Number of sides of the picture, in the order right, bottom, left, top.
const SIDES: usize = 4;
/// Shares of straight or of vertical edges in a mixture, with equal prior weights.
pub(crate) const SHARES: [f64; 4] = [0.1, 0.25, 0.5, 0.75];
/// Sds of the midpoint of a straight edge, px, with equal prior weights.
const CROOKED_PX: [f64; 3] = [0.15, 0.3, 0.6];
/// Number of pairs of a share in `SHARES` and an sd in `CROOKED_PX`.
const KINDS: usize = SHARES.len() * CROOKED_PX.len();
/// Mean distance of a curved edge's midpoint from the line through its ends, as a share of the picture's width.
const STRAY_SHARE: f64 = 0.0035;
/// Range of the distortion on the grid ([`Lens::distortion`], dimensionless).
const DISTORTIONS: [f64; 2] = [-0.6, 0.2];
/// Step of the grid of distortions (dimensionless). A turn that shows the distortion more accurately makes the grid finer.
const STEP: f64 = STRAIGHT_SD / 2.0;
/// Reach of a finer grid to either side of the turn's distortion, and its step, in sds.
const FINE: [f64; 2] = [6.0, 0.25];
/// Sd of the distortion about that of a lens that is given, or that counts as free of distortion (dimensionless).
pub const STRAIGHT_SD: f64 = 0.005;
/// Mean and sd of OpenCV's k1 of pictures with distortion. Most are distorted outwards; published values are −0.4 to 0.05.
const K1: [f64; 2] = [-0.12, 0.15];
/// Greatest k1 of these lenses, in OpenCV's convention.
const GREATEST_K1: f64 = 0.05;

/// Likelihood of the lens distortion, given the edges of a site and the turns of the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct LensView {
    size: ImageSize,
    distortions: Vec<f64>,
    /// Distortion that the turns of the camera show.
    turned: Option<TurnedLens>,
    /// Log likelihood of the edges of each side of the picture, for each of [`KINDS`], over `distortions`.
    sides: [[Vec<f64>; KINDS]; SIDES],
}

/// Focal length for the prior of the lens: mean and sd of its log (px).
pub type LogFocal = [f64; 2];

impl LensView {
    /// Computes the likelihood from long edges of a site, and from the turns of the camera.
    #[must_use]
    pub fn of(curves: &[SceneCurve], turned: Option<TurnedLens>, size: ImageSize) -> Self {
        let curves = &curves[..curves.len().min(MOST_EDGES)];
        let stray_px = STRAY_SHARE * f64::from(size.width);
        let distortions = grid(turned);
        let mut sides = std::array::from_fn(|_| std::array::from_fn(|_| vec![0.0; distortions.len()]));
        for curve in curves.iter().filter(|curve| curve.is_sound()) {
            let side: &mut [Vec<f64>; KINDS] = &mut sides[side_of(curve, size)];
            for (i, distortion) in distortions.iter().copied().enumerate() {
                let off_px = off_line(curve, Lens::with_distortion(distortion, size), size);
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
        Self { size, distortions, turned, sides }
    }

    /// Returns the log likelihood over the grid of the turns, and of the edges of all sides except `but`.
    fn logs(&self, but: Option<usize>) -> Vec<f64> {
        let sides = || (0..SIDES).filter(|side| but != Some(*side)).map(|side| &self.sides[side]);
        let of_kind = |i: usize, kind: usize| sides().map(|side| side[kind][i]).sum::<f64>();
        let of_turns =
            |distortion: f64| self.turned.map_or(0.0, |[mean, sd]| -0.5 * ((distortion - mean) / sd).powi(2));
        let distortions = self.distortions.iter().enumerate();
        distortions
            .map(|(i, distortion)| of_turns(*distortion) + log_sum((0..KINDS).map(|kind| of_kind(i, kind))))
            .collect()
    }

    /// Returns the lens and the sd of its distortion ([`Lens::distortion`], dimensionless), if the edges or the turns
    /// show one.
    #[must_use]
    pub fn found(&self, log_focal: LogFocal) -> Option<(Lens, f64)> {
        if self.turned.is_some_and(|[_, sd]| sd <= STRAIGHT_SD) {
            let [mean, sd] = self.distortion(log_focal)?;
            return Some((Lens::with_distortion(mean, self.size), sd));
        }
        let distorted = self.prior(log_focal, 0.0);
        let straight = self.prior(log_focal, 1.0);
        let gain = |but: Option<usize>| {
            let logs = self.logs(but);
            let explained =
                |prior: &[f64]| log_sum(logs.iter().zip(prior).map(|(log, prior)| log + prior.ln()));
            explained(&distorted) - explained(&straight)
        };
        let [mean, sd] = self.moments(&distorted)?;
        // Kerbs and markings of a curved road all curve alike, and lie on one side of the picture. A lens curves the
        // edges of the opposite side the other way. So the edges without those of any one side must not contradict the
        // lens.
        let of_rest = (0..SIDES).map(|side| gain(Some(side))).fold(f64::INFINITY, f64::min);
        (gain(None) > LEAST_GAIN && of_rest > 0.0).then(|| (Lens::with_distortion(mean, self.size), sd))
    }

    /// Returns the posterior mean and sd of the distortion, given the focal length; `None` where they are not finite. The
    /// odds of a picture without distortion are even.
    #[must_use]
    pub fn distortion(&self, log_focal: LogFocal) -> Option<[f64; 2]> {
        self.moments(&self.prior(log_focal, 0.5))
    }

    /// Returns the sd of the distortion about that of `lens`, given the focal length.
    #[must_use]
    pub fn sd_about(&self, lens: Lens, log_focal: LogFocal) -> f64 {
        let [mean, sd] = self.distortion(log_focal).unwrap_or_default();
        (mean - lens.distortion(self.size)).hypot(sd)
    }

    /// Returns the prior density of each distortion on the grid, averaged over the focal length.
    ///
    /// `straight_share` is the prior share of pictures without distortion.
    fn prior(&self, [log_focal, sd]: LogFocal, straight_share: f64) -> Vec<f64> {
        let mut prior = vec![0.0; self.distortions.len()];
        for (z, weight) in normal_points() {
            let [mean, sd] = distortion_of_lenses((log_focal + z * sd).exp(), self.size);
            for (density, distortion) in prior.iter_mut().zip(self.distortions.iter().copied()) {
                let distorted = normal((distortion - mean) / sd) / sd;
                let straight = normal(distortion / STRAIGHT_SD) / STRAIGHT_SD;
                *density += weight * ((1.0 - straight_share) * distorted + straight_share * straight);
            }
        }
        let sum: f64 = prior.iter().sum();
        prior.iter().map(|density| (density / sum).max(f64::MIN_POSITIVE)).collect()
    }

    /// Returns the posterior mean and sd of the distortion; `None` where they are not finite.
    fn moments(&self, prior: &[f64]) -> Option<[f64; 2]> {
        let logs = self.logs(None);
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> =
            logs.iter().zip(prior).map(|(log, prior)| (log - most).exp() * prior).collect();
        let sum: f64 = weights.iter().sum();
        let points = || self.distortions.iter().zip(&weights);
        let mean = points().map(|(at, weight)| at * weight).sum::<f64>() / sum;
        let variance = points().map(|(at, weight)| (at - mean).powi(2) * weight).sum::<f64>() / sum;
        let step = self.distortions.windows(2).map(|two| two[1] - two[0]).next().unwrap_or(STEP);
        (mean.is_finite() && variance.is_finite()).then(|| [mean, variance.sqrt().max(step)])
    }
}

/// Returns the distortion that a k1 of 1 causes, for a focal length in px.
fn distortion_of_one(focal_px: f64, size: ImageSize) -> f64 {
    (0.5 * f64::from(size.width) / focal_px).powi(2)
}

/// Returns the greatest distortion that lenses of a focal length (px) have; it corresponds to `GREATEST_K1`.
pub(crate) fn greatest_distortion(focal_px: f64, size: ImageSize) -> f64 {
    GREATEST_K1 * distortion_of_one(focal_px, size)
}

/// Returns the mean and sd of the distortion of lenses of a focal length (px), where the camera did not correct it.
pub(crate) fn distortion_of_lenses(focal_px: f64, size: ImageSize) -> [f64; 2] {
    let wide = distortion_of_one(focal_px, size);
    [K1[0] * wide, (K1[1] * wide).hypot(STRAIGHT_SD)]
}

/// Returns the grid of distortions: the whole range, or the part that an accurate turn allows, with a finer step.
fn grid(turned: Option<TurnedLens>) -> Vec<f64> {
    let accurate = turned.filter(|[_, sd]| FINE[1] * sd < STEP);
    let (ends, step) = accurate.map_or((DISTORTIONS, STEP), |[mean, sd]| {
        let reach = FINE[0] * sd;
        let middle = mean.clamp(DISTORTIONS[0] + reach, DISTORTIONS[1] - reach);
        ([middle - reach, middle + reach], FINE[1] * sd)
    });
    let count = ((ends[1] - ends[0]) / step).round() as usize;
    (0..=count).map(|i| ends[0] + step * i as f64).collect()
}

/// Returns the side of the picture's centre on which an edge's line passes, as an index from 0 (right, bottom, left,
/// top).
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

/// Returns the distance of an edge's midpoint from the line through its ends after the distortion is removed, px.
///
/// The distance is scaled to pixels of the original picture.
fn off_line(curve: &SceneCurve, lens: Lens, size: ImageSize) -> f64 {
    let from_centre: [Vector2<f64>; 3] = curve.points_px.map(|point| point - size.centre_px());
    let [a, b, c] = from_centre.map(|point| lens.undistorted(&point));
    let stretched = (c - a).norm() / (from_centre[2] - from_centre[0]).norm();
    (c - a).perp(&(b - a)) / ((c - a).norm() * stretched)
}

/// Returns a Gaussian density at `z` sds, without its normalisation.
fn normal(z: f64) -> f64 {
    (-0.5 * z * z).exp()
}

/// Returns points of a normal variable over ± 2.5 sds, each with its density, without its normalisation.
pub(crate) fn normal_points() -> impl Iterator<Item = (f64, f64)> {
    (-10..=10).map(|i| 0.25 * f64::from(i)).map(|z| (z, normal(z)))
}

/// Returns the log of the sum of exponentials.
pub(crate) fn log_sum(logs: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = logs.clone().fold(f64::NEG_INFINITY, f64::max);
    most + logs.map(|log| (log - most).exp()).sum::<f64>().ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Size of the test pictures, px.
    const SIZE: ImageSize = ImageSize { width: 1920, height: 1080 };
    /// The solver's default prior: mean and sd of log focal length (px).
    const ANY: LogFocal = [7.742, 0.6];

    /// Returns edges all over the picture as a lens shows them; every third one may be curved.
    fn curves(distortion: f64, count: u32) -> Vec<SceneCurve> {
        let lens = Lens::with_distortion(distortion, SIZE);
        let spread = |i: u32, k: u32| f64::from(i.wrapping_mul(k) % 97) / 97.0 - 0.5;
        let curve = |i: u32| {
            let middle = Vector2::new(1600.0 * spread(i, 37), 900.0 * spread(i, 53));
            let angle = 3.1 * spread(i, 71);
            let along = Vector2::new(angle.cos(), angle.sin()) * (100.0 + 150.0 * (spread(i, 29) + 0.5));
            let across = Vector2::new(-angle.sin(), angle.cos());
            let found = 0.6 * spread(i, 13) + if i.is_multiple_of(3) { 20.0 * spread(i, 17) } else { 0.0 };
            let ends = [middle - along, middle + along];
            let points = [ends[0], middle + found * across, ends[1]];
            SceneCurve { points_px: points.map(|p| lens.distorted(&p) + SIZE.centre_px()), sd_px: 0.5 }
        };
        (0..count).map(curve).collect()
    }

    #[test]
    fn the_lens_is_found_among_curved_things() {
        for distortion in [-0.25, -0.15, -0.05] {
            let found = LensView::of(&curves(distortion, 90), None, SIZE).found(ANY).unwrap();
            let off = found.0.distortion(SIZE) - distortion;
            assert!(off.abs() < 3.0 * found.1 && found.1 < 0.01, "{distortion}: {found:?}");
        }
    }

    #[test]
    fn straight_pictures_and_bare_ones_stay_straight() {
        assert_eq!(LensView::of(&curves(0.0, 90), None, SIZE).found(ANY), None);
        assert_eq!(LensView::of(&curves(-0.05, 3), None, SIZE).found(ANY), None);
        assert_eq!(LensView::of(&[], None, SIZE).found(ANY), None);
    }

    #[test]
    fn a_road_that_curves_is_no_lens() {
        // Lanes to the left of the centre, all curved alike.
        let lane = |i: i32| {
            let x = 150.0 + 40.0 * f64::from(i);
            let points = [[x + 300.0, 100.0], [x + 138.0, 500.0], [x, 900.0]].map(Vector2::from);
            SceneCurve { points_px: points, sd_px: 0.5 }
        };
        let lanes: Vec<SceneCurve> = (0..8).map(lane).collect();
        let with_houses = [&lanes[..], &curves(0.0, 20)].concat();
        assert_eq!(LensView::of(&lanes, None, SIZE).found(ANY), None);
        assert_eq!(LensView::of(&with_houses, None, SIZE).found(ANY), None);
    }

    #[test]
    fn no_narrow_view_has_the_distortion_of_a_wide_one() {
        let distorted = LensView::of(&curves(-0.25, 90), None, SIZE);
        assert!(distorted.found([800_f64.ln(), 0.05]).is_some());
        assert_eq!(distorted.found([8000_f64.ln(), 0.05]), None);
    }

    #[test]
    fn a_turn_shows_the_lens_more_accurately_than_the_grid() {
        let turned = [-0.0315, 0.0008];
        let found = LensView::of(&[], Some(turned), SIZE).found(ANY).unwrap();
        assert!((found.0.distortion(SIZE) + 0.0315).abs() < 2e-4, "{found:?}");
        assert!((found.1 / 0.0008).ln().abs() < 0.1, "{found:?}");
        // A small turn says less than the assumption of no distortion.
        let vague = [-0.0315, 0.03];
        assert_eq!(LensView::of(&[], Some(vague), SIZE).found(ANY), None);
    }

    #[test]
    fn the_prior_of_the_lens_depends_on_the_focal_length() {
        let bare = LensView::of(&[], None, SIZE);
        let sd = |focal_px: f64| bare.sd_about(Lens::STRAIGHT, [focal_px.ln(), 0.05]);
        assert!(sd(5000.0) < 0.01 && sd(1000.0) > 0.08, "{} {}", sd(5000.0), sd(1000.0));
        let seen = LensView::of(&curves(0.0, 90), None, SIZE);
        assert!(seen.sd_about(Lens::STRAIGHT, [1000_f64.ln(), 0.05]) < 0.006);
    }
}
