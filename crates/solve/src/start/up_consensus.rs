//! Plane hypotheses from single cars: the direction that most cars hold for up (the paper's RANSAC on `{R_k}`), tried
//! exhaustively instead of at random, and the height that their sizes imply (its RANSAC on `{T_k}`).
//!
//! Size says depth: a car seen with s px/m is at z = f/s, so `n · T + h = 0` reads `s = −(n_x u + n_y v + n_z f) / h`.

use nalgebra::{Vector3, Vector4};
use roadplane_base::GroundPlane;

use crate::start::weak_perspective::Appearance;

/// Width of agreement between cars' up directions, rad.
const AGREEMENT_RAD: f64 = 0.14;
/// Per unit of an appearance's extra cost over the car's best one, its vote halves this many times.
const COST_SCALE: f64 = 0.35;
/// A second plane is tried when it has at least this share of the best one's support.
const MIN_SUPPORT: f64 = 0.5;
/// Steepest and shallowest tilt of a hypothesis, rad.
const TILT_RANGE: [f64; 2] = [-0.05, 1.5];
/// Its largest roll, rad.
const MAX_ROLL: f64 = 0.8;
/// Its least height, m.
const MIN_HEIGHT_M: f64 = 0.3;

/// Cameras (log f, tilt, roll, log h) that the cars agree on at this focal length, best supported first.
pub(crate) fn planes_for_focal(cars: &[Vec<Appearance>], focal_px: f64, most: usize) -> Vec<Vector4<f64>> {
    // (car, vote, up in camera frame, index of appearance)
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

/// Averages around a seed direction and reads tilt, roll and height.
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

/// Camera (log f, tilt, roll, log h) with this direction up over cars at these positions: the height is their median.
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
