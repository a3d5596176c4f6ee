//! Estimates the vertical vanishing point from edges of a picture: a second source of the focal length.
//!
//! Cars determine the horizon (focal · tan tilt) well, but not the split between focal length and tilt. The pictures of
//! vertical lines meet in one point or are parallel. This point and the horizon lie on opposite sides of the principal
//! point. The product of their distances is focal² (Caprile and Torre 1990).
//!
//! At the pixel p a vertical line runs along `(sin roll, −cos roll) + d · p`. Here d, the `inverse_distance`, is one over
//! the distance of the vertical vanishing point from the principal point: tan(tilt) / focal, 1/px.
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

use nalgebra::{Matrix3, Vector3};
use roadplane_base::{Camera, CameraEstimate, SceneLine};

use self::field::{Field, Node};
use crate::factors::{VerticalVanishingPoint, WEAKEST};
use crate::lens::{
    LEAST_GAIN, MOST_EDGES, STRAIGHT_SD, distortion_of_lenses, greatest_distortion, log_sum, normal_points,
};

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

/// Estimates the vertical of the scene from its edges and the camera that all other evidence gives.
///
/// `None` where the edges do not show a vertical, or where it hardly determines the focal length.
#[must_use]
pub fn verticals(lines: &[SceneLine], camera: &CameraEstimate) -> Option<Verticals> {
    let prior = Prior::of(camera)?;
    let width = f64::from(camera.image_size_px.width);
    let field = Field::new(&lines[..lines.len().min(MOST_EDGES)], &camera.principal_point_px, width);
    let (best, gain) = search(&field, &prior)?;
    if gain.is_nan() || gain < LEAST_GAIN {
        return None;
    }
    let (mean, covariance) = moments(&field, &prior, best)?;
    let (inverse_distance, roll, lens) = (mean.x, mean.y, mean.z);
    let mut covariance = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    // An error of the principal point shifts the centre of the vertical lines and of the lens distortion.
    let principal_point = Camera::PRINCIPAL_POINT_SD * width;
    let of_lens = 2.0 * lens / (field.half_width * field.half_width);
    covariance[(0, 0)] += (principal_point * (inverse_distance * inverse_distance).hypot(of_lens)).powi(2);
    covariance[(1, 1)] += (principal_point * inverse_distance).powi(2);
    // Log focal is (log horizon − log `inverse_distance`) / 2. A slope of the road changes `inverse_distance`, but not the
    // horizon from cars.
    let tilt = (inverse_distance * prior.focal_px).atan();
    let slope = VerticalVanishingPoint::SLOPE_SD / (tilt.sin() * tilt.cos());
    let log_focal_sd = 0.5 * (covariance[(0, 0)].sqrt() / inverse_distance).hypot(slope);
    if !(inverse_distance > 0.0 && log_focal_sd < WEAKEST) {
        return None;
    }
    let upright = field.probabilities(&mean).into_iter().map(|probability| probability > 0.5).collect();
    Some(Verticals { factor: VerticalVanishingPoint { inverse_distance, roll, covariance }, gain, upright })
}

/// Prior of the vertical and the lens from the camera.
struct Prior {
    focal_px: f64,
    log_focal_sd: f64,
    /// Distance of the horizon from the principal point and its sd, px.
    horizon: [f64; 2],
    /// Roll and its sd, rad.
    roll: [f64; 2],
    /// Mean and sd of the lens distortion: the share by which the half width is drawn in
    /// (negative) or out.
    lens: [f64; 2],
    /// Greatest lens distortion, with a soft limit of sd [`STRAIGHT_SD`].
    ///
    /// Without this limit, lanes below the picture's centre would pass for walls that the lens distorts.
    greatest_lens: f64,
}

impl Prior {
    /// Builds the prior from the camera; `None` where it does not determine the horizon.
    fn of(camera: &CameraEstimate) -> Option<Self> {
        let (tilt, focal_px) = (camera.params.tilt, camera.params.focal_px());
        let covariance = &camera.covariance;
        let by = nalgebra::Vector4::new(focal_px * tilt.tan(), focal_px / tilt.cos().powi(2), 0.0, 0.0);
        let horizon = [by.x, by.dot(&(covariance * by)).max(0.0).sqrt()];
        // The method multiplies with the horizon's distance, so the ground must lie below a determined horizon.
        if !(horizon[0] > 2.0 * horizon[1] && horizon[1].is_finite()) {
            return None;
        }
        let size = camera.image_size_px;
        let (lens, greatest_lens) = match camera.distortion_sd {
            None => (distortion_of_lenses(focal_px, size), greatest_distortion(focal_px, size)),
            Some(sd) => ([camera.lens.distortion(size), sd.max(STRAIGHT_SD)], f64::INFINITY),
        };
        Some(Self {
            focal_px,
            log_focal_sd: covariance[(0, 0)].sqrt(),
            horizon,
            roll: [camera.params.roll, 1.5 * covariance[(2, 2)].sqrt()],
            lens,
            greatest_lens,
        })
    }

    /// Returns the density of an inverse distance (1/px), up to a constant.
    ///
    /// It averages over the focal length along the horizon, and over slopes of the road.
    fn of_inverse_distance(&self, inverse_distance: f64) -> f64 {
        let density = |(z, weight): (f64, f64)| {
            let focal_px = self.focal_px * (z * self.log_focal_sd).exp();
            let tilt = (self.horizon[0] / focal_px).atan();
            let horizon_sd = 2.0 * self.horizon[1] / focal_px * tilt.cos().powi(2);
            let tan = inverse_distance * focal_px;
            let angle_by_inverse_distance = focal_px / (1.0 + tan * tan);
            weight * sloped(tan.atan() - tilt, horizon_sd) * angle_by_inverse_distance
        };
        normal_points().map(density).sum()
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

/// Number of steps of a grid to either side of its middle, and of rounds in which the grid is set anew.
const STEPS: i32 = 5;
/// Range of such a grid to either side, sds.
const REACH: f64 = 3.0;
/// Step of the search, rad: of the roll, and of a vertical line's direction at the side of the picture.
const SEARCH_STEP: f64 = 0.007;
/// Least prior density of a node that is searched, as a share of the greatest.
const UNLIKELY: f64 = 1e-5;

/// Returns the most probable node given cars and edges, and the log Bayes factor of all nodes over chance.
fn search(field: &Field, prior: &Prior) -> Option<(Node, f64)> {
    let half = field.half_width;
    let count = |reach: f64| (reach / SEARCH_STEP) as i32;
    let inverse_distances: Vec<(f64, f64)> = (1..count(1.0))
        .map(|i| {
            let angle = (f64::from(i) - 0.5) * SEARCH_STEP;
            let (inverse_distance, step) = (angle.tan() / half, SEARCH_STEP / angle.cos().powi(2) / half);
            (inverse_distance, step * prior.of_inverse_distance(inverse_distance))
        })
        .collect();
    let reach = count(2.0 * REACH * VerticalVanishingPoint::SLOPE_SD);
    let rolls: Vec<(f64, f64)> = (-reach..=reach)
        .map(|i| prior.roll[0] + f64::from(i) * SEARCH_STEP)
        .map(|roll| (roll, prior.of_roll(roll)))
        .collect();
    let lenses: Vec<(f64, f64)> = (-STEPS..=STEPS)
        .map(|i| prior.lens[0] + REACH * prior.lens[1] * f64::from(i) / f64::from(STEPS))
        .map(|lens| (lens, prior.of_lens(lens)))
        .collect();
    let total = |of: &[(f64, f64)]| of.iter().map(|(_, weight)| weight).sum::<f64>();
    let most = |of: &[(f64, f64)]| of.iter().map(|(_, weight)| *weight).fold(0.0, f64::max);
    let all = total(&inverse_distances) * total(&rolls) * total(&lenses);
    let least = UNLIKELY * most(&inverse_distances) * most(&rolls);
    let mut found: Vec<(Node, f64)> = Vec::new();
    for (lens, of_lens) in &lenses {
        let seen = field.undistorted(*lens);
        for (inverse_distance, of_inverse_distance) in &inverse_distances {
            for (roll, of_roll) in rolls.iter().filter(|(_, of_roll)| of_inverse_distance * of_roll > least) {
                let node = Node::new(*inverse_distance, *roll, *lens);
                let weight = (of_inverse_distance * of_roll * of_lens / all).ln();
                found.push((node, weight + field.log_ratio(&seen, &node)));
            }
        }
    }
    let best = found.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    Some((best.0, log_sum(found.iter().map(|(_, log)| *log))))
}

/// Returns the mean node and the covariance of (`inverse_distance`, roll, lens), given the edges and the lens prior and
/// without the cars.
///
/// `None` where the covariance is not finite or not positive definite.
fn moments(field: &Field, prior: &Prior, best: Node) -> Option<(Node, Matrix3<f64>)> {
    let half = field.half_width;
    let step = SEARCH_STEP / (best.x * half).atan().cos().powi(2) / half;
    let (mut mean, mut covariance) = (best, Matrix3::zeros());
    let mut sd = Vector3::new(step, SEARCH_STEP, 2.0 * REACH / f64::from(STEPS) * prior.lens[1]);
    for _ in 0..STEPS {
        let reach = |i: i32, k: i32, l: i32| {
            mean + Vector3::new(f64::from(i), f64::from(k), f64::from(l)).component_mul(&sd) * REACH
                / f64::from(STEPS)
        };
        let mut nodes: Vec<(Node, f64)> = Vec::new();
        for l in -STEPS..=STEPS {
            let lens = reach(0, 0, l).z;
            let (seen, of_lens) = (field.undistorted(lens), prior.of_lens(lens).max(f64::MIN_POSITIVE).ln());
            let steps = (-STEPS..=STEPS).flat_map(|i| (-STEPS..=STEPS).map(move |k| (i, k)));
            nodes.extend(
                steps
                    .map(|(i, k)| reach(i, k, l))
                    .map(|node| (node, of_lens + field.log_ratio(&seen, &node))),
            );
        }
        let most = nodes.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
        for (_, log) in &mut nodes {
            *log = (*log - most).exp();
        }
        let total: f64 = nodes.iter().map(|(_, weight)| weight).sum();
        mean = nodes.iter().map(|(node, weight)| node * *weight).sum::<Node>() / total;
        let square = |(node, weight): &(Node, f64)| (node - mean) * (node - mean).transpose() * *weight;
        covariance = nodes.iter().map(square).sum::<Matrix3<f64>>() / total;
        sd = covariance.diagonal().map(f64::sqrt);
    }
    let is_sound = covariance.iter().all(|v| v.is_finite()) && covariance.cholesky().is_some();
    is_sound.then_some((mean, covariance))
}
