//! Solves full perspective: minimises `½ ‖(W̃ Z − R S(c) − T 1ᵀ) D^½‖² + λ/2 ‖c‖²` by block coordinate descent.
//!
//! W̃ are the viewing rays, Z their depths, and D the confidences. R and T are the rotation and translation of the car.
//! S(c) are its points with the shape coefficients c.
//!
//! For a given pose, the best depth puts an observation at the foot of the perpendicular from the point to the viewing
//! ray w_i. With `P_i = I − w_i w_iᵀ / w_iᵀ w_i`, the cost is then `½ Σ d_i ‖P_i (R S_i + T)‖²`. This cost contains the
//! squared distances of the points from their rays, weighted by the confidences d_i.
//!
//! So depths and translation are solved together in closed form (Lu, Hager, Mjolsness 2000, Eq. 20). The code of
//! Pavlakos et al. alternates between depths and translation. It finds the same minimum in far more rounds.

use nalgebra::{Isometry3, Matrix3, Matrix6, Rotation3, Translation3, UnitQuaternion, Vector3};
use roadplane_base::{MODES, Shape};

use super::basis::{Basis, COST_TOLERANCE, KEYPOINT_SD_M, MAX_ROUNDS, nearest_rotation, weighted_mean};
use super::weak::WeakPerspective;
use crate::CarFit;
use crate::evidence::Observation;

pub(super) fn solve(basis: &Basis, observations: &[Observation], start: &WeakPerspective) -> Option<CarFit> {
    let across: Vec<Matrix3<f64>> = observations
        .iter()
        .map(|s| Matrix3::identity() - s.ray * s.ray.transpose() / s.ray.norm_squared())
        .collect();
    let mut rotation = start.camera_from_car;
    let mut shape = start.shape;
    let mut points = basis.shape(&shape);
    // The initial depth follows from the scale of weak perspective.
    let mut translation =
        start.centre.push(1.0) / start.scale - rotation * weighted_mean(&points, observations);
    let mut last_cost = f64::INFINITY;
    for _ in 0..MAX_ROUNDS {
        rotation = turned(&rotation, &translation, &points, &across, observations)?;
        translation = best_translation(&rotation, &points, &across, observations)?;
        shape = best_shape(basis, &rotation, &translation, &across, observations)?;
        points = basis.shape(&shape);
        let off = |((x, p), s): ((&Vector3<f64>, &Matrix3<f64>), &Observation)| {
            s.weight * (p * (rotation * x + translation)).norm_squared()
        };
        let data: f64 = points.iter().zip(&across).zip(observations).map(off).sum();
        let cost = 0.5 * data + 0.5 * KEYPOINT_SD_M.powi(2) * shape.norm_squared();
        if last_cost - cost <= COST_TOLERANCE * cost {
            break;
        }
        last_cost = cost;
    }
    let finite = translation.iter().chain(rotation.iter()).all(|v| v.is_finite());
    // The cost treats both directions of a ray alike, so a car behind the camera is rejected here.
    (finite && translation.z > 0.0).then(|| {
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        let camera_from_car = Isometry3::from_parts(Translation3::from(translation), rotation);
        CarFit { camera_from_car, shape }
    })
}

/// Returns the rotation that best moves the points onto their viewing rays (Procrustes about the means). `across` are
/// the matrices P_i, which project onto the plane across the viewing ray of point i.
fn turned(
    rotation: &Matrix3<f64>,
    translation: &Vector3<f64>,
    points: &[Vector3<f64>],
    across: &[Matrix3<f64>],
    observations: &[Observation],
) -> Option<Matrix3<f64>> {
    let foot = |(x, p): (&Vector3<f64>, &Matrix3<f64>)| {
        let here = rotation * x + translation;
        here - p * here
    };
    let feet: Vec<Vector3<f64>> = points.iter().zip(across).map(foot).collect();
    let (mean, mean_foot) = (weighted_mean(points, observations), weighted_mean(&feet, observations));
    let mut cross = Matrix3::zeros();
    for ((x, foot), s) in points.iter().zip(&feet).zip(observations) {
        cross += (foot - mean_foot) * (x - mean).transpose() * s.weight;
    }
    nearest_rotation(&cross)
}

/// Returns the best translation for a given rotation and shape, by linear least squares.
fn best_translation(
    rotation: &Matrix3<f64>,
    points: &[Vector3<f64>],
    across: &[Matrix3<f64>],
    observations: &[Observation],
) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for ((x, p), s) in points.iter().zip(across).zip(observations) {
        normal += p * s.weight;
        right -= p * (rotation * x) * s.weight;
    }
    Some(normal.cholesky()?.solve(&right))
}

/// Returns the best shape coefficients for a given rotation and translation, by ridge regression.
fn best_shape(
    basis: &Basis,
    rotation: &Matrix3<f64>,
    translation: &Vector3<f64>,
    across: &[Matrix3<f64>],
    observations: &[Observation],
) -> Option<Shape> {
    let mut normal = Matrix6::identity() * KEYPOINT_SD_M.powi(2);
    let mut right = Shape::zeros();
    for (i, s) in observations.iter().enumerate() {
        let columns: [Vector3<f64>; MODES] =
            std::array::from_fn(|j| across[i] * (rotation * basis.modes[j][i]));
        let off = across[i] * (rotation * basis.mean[i] + translation);
        for j in 0..MODES {
            right[j] -= s.weight * columns[j].dot(&off);
            for k in 0..MODES {
                normal[(j, k)] += s.weight * columns[j].dot(&columns[k]);
            }
        }
    }
    Some(normal.cholesky()?.solve(&right))
}
