//! Estimates the vertical vanishing point from edges of a picture: a second source of the focal length.
//!
//! Cars determine the horizon (focal · tan tilt) well, but not the split between focal length and tilt. The pictures of
//! vertical lines meet in one point or are parallel. This point and the horizon lie on opposite sides of the principal
//! point. The product of their distances is focal² (Caprile and Torre 1990).
//!
//! At the pixel p a vertical line runs along `(sin roll, −cos roll) + bend · p`. Here `bend` is tan(tilt) / focal, the
//! inverse distance of the vertical vanishing point, 1/px.
//!
//! Edges are a mixture. An unknown share is vertical up to a lean and the edge's own sd; the others point anywhere. The
//! inverse distance, the roll and the lens distortion are searched on a grid ([`field`](self::field)). Edges beside
//! each other count as one, because they share the lean of one object.
//!
//! The result is used only if it explains the edges a hundred times better than chance, over all cameras that the cars
//! allow. Otherwise there is no factor. This is a-contrario reasoning (after Desolneux, Moisan and Morel 2000) with a
//! Bayes factor. Lanes do not pass the test: lines on the ground diverge downwards, while verticals converge below a
//! camera that looks down.

mod field;

use nalgebra::{Matrix2, Vector2};
use roadplane_base::{Camera, CameraEstimate, SceneLine};

use self::field::{Field, Node};
use crate::factors::{VerticalVanishingPoint, WEAKEST};
use crate::lens::{LEAST_GAIN, MOST_EDGES, STRAIGHT_SD, bend_of_lenses, greatest_bend};

/// The vertical of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Verticals {
    /// Factor on the camera.
    pub factor: VerticalVanishingPoint,
    /// Log Bayes factor over chance.
    pub gain: f64,
    /// Whether each edge is vertical. If there are very many edges, only the first ones are listed.
    pub upright: Vec<bool>,
}

/// Estimates the vertical of the scene from its edges and the camera that the cars alone determine.
///
/// `None` where the edges do not show a vertical, or where it hardly determines the focal length.
#[must_use]
pub fn verticals(lines: &[SceneLine], cars: &CameraEstimate) -> Option<Verticals> {
    let prior = Prior::of(cars)?;
    let width = f64::from(cars.image_size_px.width);
    let field = Field::new(&lines[..lines.len().min(MOST_EDGES)], &cars.principal_point_px, width);
    let (best, gain) = search(&field, &prior)?;
    if gain < LEAST_GAIN {
        return None;
    }
    let Moments { mean, mut covariance } = moments(&field, &prior, best)?;
    // An error of the principal point shifts the centre of the vertical lines and of the lens distortion.
    let principal_point = Camera::PRINCIPAL_POINT_SD * width;
    let of_lens = 2.0 * mean.lens / (field.half_width() * field.half_width());
    covariance[(0, 0)] += (principal_point * (mean.bend * mean.bend).hypot(of_lens)).powi(2);
    covariance[(1, 1)] += (principal_point * mean.bend).powi(2);
    // Log focal is (log horizon − log `bend`) / 2. A slope of the road changes `bend`, but not the horizon from cars.
    let tilt = (mean.bend * prior.focal_px).atan();
    let slope = VerticalVanishingPoint::SLOPE_SD / (tilt.sin() * tilt.cos());
    let log_focal_sd = 0.5 * (covariance[(0, 0)].sqrt() / mean.bend).hypot(slope);
    if !(mean.bend > 0.0 && log_focal_sd < WEAKEST) {
        return None;
    }
    let upright = field.trust(&mean).into_iter().map(|trust| trust > 0.5).collect();
    Some(Verticals {
        factor: VerticalVanishingPoint { inverse_distance: mean.bend, roll: mean.roll, covariance },
        gain,
        upright,
    })
}

/// Prior of the vertical and the lens from the cars.
struct Prior {
    /// Focal length, px.
    focal_px: f64,
    /// Sd of log focal length.
    log_focal_sd: f64,
    /// Distance of the horizon from the principal point and its sd, px.
    horizon: [f64; 2],
    /// Roll and its sd, rad.
    roll: [f64; 2],
    /// Mean and sd of the lens distortion: the share by which the half width is drawn in.
    lens: [f64; 2],
    /// Greatest lens distortion, with a soft limit of sd [`STRAIGHT_SD`].
    ///
    /// Without this limit, lanes below the picture's centre would pass for walls that the lens distorts.
    greatest_lens: f64,
}

impl Prior {
    /// Builds the prior from the camera of the cars; `None` where they do not determine the horizon.
    fn of(cars: &CameraEstimate) -> Option<Self> {
        let (tilt, focal_px) = (cars.params.tilt, cars.params.focal_px());
        let covariance = &cars.covariance;
        let by = nalgebra::Vector4::new(focal_px * tilt.tan(), focal_px / tilt.cos().powi(2), 0.0, 0.0);
        let horizon = [by.x, by.dot(&(covariance * by)).max(0.0).sqrt()];
        // The method multiplies with the horizon's distance, so the ground must lie below a determined horizon.
        if !(horizon[0] > 2.0 * horizon[1] && horizon[1].is_finite()) {
            return None;
        }
        Some(Self {
            focal_px,
            log_focal_sd: covariance[(0, 0)].sqrt(),
            horizon,
            roll: [cars.params.roll, 1.5 * covariance[(2, 2)].sqrt()],
            lens: cars.distortion_sd.map_or_else(
                || bend_of_lenses(focal_px, cars.image_size_px),
                |sd| [cars.lens.distortion(cars.image_size_px), sd.max(STRAIGHT_SD)],
            ),
            greatest_lens: match cars.distortion_sd {
                None => greatest_bend(focal_px, cars.image_size_px),
                Some(_) => f64::INFINITY,
            },
        })
    }

    /// Returns the density of an inverse distance `bend` (1/px), up to a constant.
    ///
    /// It averages over the focal length along the horizon, and over slopes of the road.
    fn of_bend(&self, bend: f64) -> f64 {
        let steps = (-10..=10).map(|i| 0.25 * f64::from(i));
        let density = |z: f64| {
            let focal_px = self.focal_px * (z * self.log_focal_sd).exp();
            let tilt = (self.horizon[0] / focal_px).atan();
            let horizon_sd = 2.0 * self.horizon[1] / focal_px * tilt.cos().powi(2);
            let seen = bend * focal_px;
            let per_bend = focal_px / (1.0 + seen * seen);
            (-0.5 * z * z).exp() * sloped(seen.atan() - tilt, horizon_sd) * per_bend
        };
        steps.map(density).sum()
    }

    /// Returns the density of a roll (rad), up to a constant.
    fn of_roll(&self, roll: f64) -> f64 {
        sloped(roll - self.roll[0], self.roll[1])
    }

    /// Returns the density of a lens distortion, up to a constant.
    fn of_lens(&self, lens: f64) -> f64 {
        let beyond = (lens - self.greatest_lens).max(0.0) / STRAIGHT_SD;
        (-0.5 * (((lens - self.lens[0]) / self.lens[1]).powi(2) + beyond * beyond)).exp()
    }
}

/// Returns the density of the angle (rad) between the normal of the road and the vertical, up to a constant.
///
/// `sd` is the measurement error of the angle, rad.
fn sloped(angle: f64, sd: f64) -> f64 {
    let normal = |slope_sd: f64| {
        let sd = sd.hypot(slope_sd);
        (-0.5 * (angle / sd).powi(2)).exp() / sd
    };
    (1.0 - VerticalVanishingPoint::STEEP_SHARE) * normal(VerticalVanishingPoint::SLOPE_SD)
        + VerticalVanishingPoint::STEEP_SHARE * normal(VerticalVanishingPoint::STEEP_SD)
}

/// Step of the search, rad: of the roll, and of a vertical line's direction at the side of the picture.
const SEARCH_STEP: f64 = 0.007;
/// Range of the search for the roll, to either side of the cars' roll, rad.
const SEARCH_ROLL: f64 = 0.105;
/// Number of search steps of the lens distortion to either side of its mean.
const LENS_STEPS: i32 = 4;
/// Range of the search for the lens distortion, to either side of its mean, sds.
const LENS_REACH: f64 = 2.2;
/// Least prior density of a node that is searched, as a share of the greatest.
const UNLIKELY: f64 = 1e-5;

/// Returns the most probable node given cars and edges, and the log Bayes factor of all nodes over chance.
fn search(field: &Field, prior: &Prior) -> Option<(Node, f64)> {
    let half = field.half_width();
    let count = |reach: f64| (reach / SEARCH_STEP) as i32;
    let bends: Vec<(f64, f64)> = (1..count(1.0))
        .map(|i| {
            let angle = (f64::from(i) - 0.5) * SEARCH_STEP;
            (angle.tan() / half, SEARCH_STEP / angle.cos().powi(2) / half)
        })
        .map(|(bend, step)| (bend, step * prior.of_bend(bend)))
        .collect();
    let rolls: Vec<(f64, f64)> = (-count(SEARCH_ROLL)..=count(SEARCH_ROLL))
        .map(|i| prior.roll[0] + f64::from(i) * SEARCH_STEP)
        .map(|roll| (roll, prior.of_roll(roll)))
        .collect();
    let lenses: Vec<(f64, f64)> = (-LENS_STEPS..=LENS_STEPS)
        .map(|i| prior.lens[0] + LENS_REACH * prior.lens[1] * f64::from(i) / f64::from(LENS_STEPS))
        .map(|lens| (lens, prior.of_lens(lens)))
        .collect();
    let total = |of: &[(f64, f64)]| of.iter().map(|(_, weight)| weight).sum::<f64>();
    let most = |of: &[(f64, f64)]| of.iter().map(|(_, weight)| *weight).fold(0.0, f64::max);
    let all = total(&bends) * total(&rolls) * total(&lenses);
    let least = UNLIKELY * most(&bends) * most(&rolls);
    let mut found: Vec<(Node, f64)> = Vec::new();
    for (lens, of_lens) in &lenses {
        let seen = field.undistorted(*lens);
        for (bend, of_bend) in &bends {
            for (roll, of_roll) in rolls.iter().filter(|(_, of_roll)| of_bend * of_roll > least) {
                let node = Node { bend: *bend, roll: *roll, lens: *lens };
                let weight = (of_bend * of_roll * of_lens / all).ln();
                found.push((node, weight + field.log_ratio(&seen, &node)));
            }
        }
    }
    let best = found.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    let sum: f64 = found.iter().map(|(_, log)| (log - best.1).exp()).sum();
    Some((best.0, best.1 + sum.ln()))
}

/// Moments of the edges' likelihood around a node.
struct Moments {
    /// Mean node.
    mean: Node,
    /// Covariance of the inverse distance `bend` (1/px) and the roll (rad).
    covariance: Matrix2<f64>,
}

/// Number of rounds of computing moments on a grid; each grid follows from the moments of the previous round.
const ROUNDS: usize = 5;
/// Number of steps of that grid to either side.
const STEPS: i32 = 5;
/// Range of that grid to either side, sds.
const REACH: f64 = 3.0;

/// Returns the mean and covariance of (`bend`, roll) given the edges and the lens prior, without the cars.
///
/// `None` where the covariance is not finite or not positive definite.
fn moments(field: &Field, prior: &Prior, best: Node) -> Option<Moments> {
    let step = SEARCH_STEP / (best.bend * field.half_width()).atan().cos().powi(2);
    let mut mean = best;
    let mut covariance =
        Matrix2::from_diagonal(&Vector2::new(step / field.half_width(), SEARCH_STEP).map(|s| s * s));
    let mut lens_sd = 2.0 * LENS_REACH / f64::from(LENS_STEPS) * prior.lens[1];
    for _ in 0..ROUNDS {
        let reach = |i: i32, sd: f64| REACH * sd * f64::from(i) / f64::from(STEPS);
        let sd = covariance.diagonal().map(f64::sqrt);
        let mut told: Vec<(Node, f64)> = Vec::new();
        for lens in (-STEPS..=STEPS).map(|i| mean.lens + reach(i, lens_sd)) {
            let seen = field.undistorted(lens);
            let of_lens = prior.of_lens(lens).max(1e-300).ln();
            for i in -STEPS..=STEPS {
                for k in -STEPS..=STEPS {
                    let node =
                        Node { bend: mean.bend + reach(i, sd.x), roll: mean.roll + reach(k, sd.y), lens };
                    told.push((node, of_lens + field.log_ratio(&seen, &node)));
                }
            }
        }
        let most = told.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
        for (_, log) in &mut told {
            *log = (*log - most).exp();
        }
        let total: f64 = told.iter().map(|(_, weight)| weight).sum();
        let average = |of: &dyn Fn(&Node) -> f64| told.iter().map(|(n, w)| w * of(n)).sum::<f64>() / total;
        let next =
            Node { bend: average(&|n| n.bend), roll: average(&|n| n.roll), lens: average(&|n| n.lens) };
        let (bend, roll) = (|n: &Node| n.bend - next.bend, |n: &Node| n.roll - next.roll);
        let cross = average(&|n| bend(n) * roll(n));
        covariance = Matrix2::new(average(&|n| bend(n).powi(2)), cross, cross, average(&|n| roll(n).powi(2)));
        lens_sd = average(&|n| (n.lens - next.lens).powi(2)).sqrt();
        mean = next;
    }
    let is_sound = covariance.iter().all(|v| v.is_finite()) && covariance.cholesky().is_some();
    is_sound.then_some(Moments { mean, covariance })
}
