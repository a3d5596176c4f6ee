//! Hypotheses about the ground plane, from the possible views of single cars.
//!
//! The plane's normal n is the up direction on which most cars agree. The paper *Car Pose in Context* uses RANSAC on
//! the cars' rotations. Here, all candidates are tried instead of random ones.
//!
//! The height h follows from the cars' sizes in the image. A car with a scale of s px/m is at the depth z = f/s, where
//! f is the focal length in px. Let (u, v) be the car's pixel relative to the principal point, and T its position. Then
//! `n · T + h = 0` becomes `s = −(n_x u + n_y v + n_z f) / h`. The paper uses RANSAC on the cars' positions.

use nalgebra::{Vector3, Vector4};
use roadplane_base::GroundPlane;

use crate::start::weak_perspective::Appearance;

/// Sd of the Gaussian that weights an up direction by its angle to another up direction, rad.
const AGREEMENT_RAD: f64 = 0.14;
/// Rate r at which the vote of a possible view falls with its cost.
///
/// The vote is exp(−r · (cost − lowest cost over the car's possible views)).
const COST_SCALE: f64 = 0.35;
/// Smallest support of a plane, as a fraction of the support of the best plane.
const MIN_SUPPORT: f64 = 0.5;
/// Smallest and largest tilt of a hypothetical camera, rad.
const TILT_RANGE: [f64; 2] = [-0.05, 1.5];
/// Largest roll of a hypothetical camera, rad.
const MAX_ROLL: f64 = 0.8;
/// Smallest height of a hypothetical camera above the ground, m.
const MIN_HEIGHT_M: f64 = 0.3;

/// Returns up to `most` cameras (log f, tilt, roll, log h) with this focal length that agree with many cars.
///
/// The camera with the largest support comes first. `cars` contains the possible views of each car.
pub(crate) fn planes_for_focal(cars: &[Vec<Appearance>], focal_px: f64, most: usize) -> Vec<Vector4<f64>> {
    // Entries: (index of the car, vote, up direction in the camera frame, index of the possible view).
    let mut ballots: Vec<(usize, f64, Vector3<f64>, usize)> = Vec::new();
    for (k, appearances) in cars.iter().enumerate() {
        let Some(best) = appearances.first() else { continue };
        for (n, appearance) in appearances.iter().enumerate() {
            let up = appearance.camera_from_car(focal_px).column(2).into_owned();
            ballots.push((k, (-COST_SCALE * (appearance.cost - best.cost)).exp(), up, n));
        }
    }
    let support = |up: &Vector3<f64>| {
        let mut per_car = vec![0.0_f64; cars.len()];
        for (k, vote, other, _) in &ballots {
            let off = (up - other).norm_squared() / (AGREEMENT_RAD * AGREEMENT_RAD);
            per_car[*k] = per_car[*k].max(vote * (-0.5 * off).exp());
        }
        per_car.iter().sum::<f64>()
    };
    let mut ranked: Vec<(f64, Vector3<f64>)> = ballots.iter().map(|b| (support(&b.2), b.2)).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut planes: Vec<Vector4<f64>> = Vec::new();
    let mut taken: Vec<Vector3<f64>> = Vec::new();
    let enough = MIN_SUPPORT * ranked.first().map_or(0.0, |best| best.0);
    for (support, seed) in ranked {
        if planes.len() >= most || support < enough {
            break;
        }
        if taken.iter().any(|t| (t - seed).norm() < 2.0 * AGREEMENT_RAD) {
            continue;
        }
        taken.push(seed);
        planes.extend(camera_from_up(cars, &ballots, &seed, focal_px));
    }
    planes
}

/// Returns the camera (log f, tilt, roll, log h) whose up direction is the weighted mean of directions near `seed`.
///
/// Returns `None` if there is no valid camera.
fn camera_from_up(
    cars: &[Vec<Appearance>],
    ballots: &[(usize, f64, Vector3<f64>, usize)],
    seed: &Vector3<f64>,
    focal_px: f64,
) -> Option<Vector4<f64>> {
    let mut sum = Vector3::zeros();
    let mut chosen: Vec<Option<(f64, usize)>> = vec![None; cars.len()];
    for (k, vote, up, n) in ballots {
        let off = (up - seed).norm_squared() / (AGREEMENT_RAD * AGREEMENT_RAD);
        let weight = vote * (-0.5 * off).exp();
        sum += up * weight;
        if chosen[*k].is_none_or(|(best, _)| weight > best) {
            chosen[*k] = Some((weight, *n));
        }
    }
    let up = sum.try_normalize(1e-12)?;
    let position = |a: &Appearance| Vector3::new(a.origin.x, a.origin.y, focal_px) / a.scale;
    let chosen = chosen.iter().zip(cars).filter_map(|(choice, car)| car.get(choice.as_ref()?.1));
    camera_on(focal_px, &up, chosen.map(position))
}

/// Returns the camera (log f, tilt, roll, log h) with this up direction, above cars at these positions.
///
/// Up direction and positions (m) are in the camera frame. The height is the median over the cars. Returns `None` if
/// there is no car below the camera, or if the roll is too large.
pub(crate) fn camera_on(
    focal_px: f64,
    up: &Vector3<f64>,
    positions: impl Iterator<Item = Vector3<f64>>,
) -> Option<Vector4<f64>> {
    let tilt = (-up.z).clamp(-1.0, 1.0).asin().clamp(TILT_RANGE[0], TILT_RANGE[1]);
    let roll = up.x.atan2(-up.y);
    let up = GroundPlane::from_tilt_roll_height(tilt, roll, 1.0).normal_in_camera;
    let mut heights: Vec<f64> = positions.map(|p| -up.dot(&p)).filter(|h| *h > MIN_HEIGHT_M).collect();
    heights.sort_by(f64::total_cmp);
    let height = heights.get(heights.len() / 2)?;
    (roll.abs() <= MAX_ROLL).then(|| Vector4::new(focal_px.ln(), tilt, roll, height.ln()))
}
