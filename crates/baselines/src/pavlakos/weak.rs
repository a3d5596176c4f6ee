//! Solves weak perspective: minimises `½ ‖(W − s R̄ S(c) − t 1ᵀ) D^½‖² + λ/2 ‖c‖²` by block coordinate descent. The
//! initial values come from the convex relaxation.
//!
//! W are the image points and D the confidences. The scale is s, the first two rows of the rotation are R̄, and the
//! translation is t. S(c) are the points of the car with the shape coefficients c.

use nalgebra::{Matrix2x3, Matrix3, Matrix6, Vector2, Vector3};
use roadplane_base::{MODES, Shape};

use super::basis::{Basis, COST_TOLERANCE, KEYPOINT_SD_M, MAX_ROUNDS, nearest_rotation, weighted_mean};
use super::relaxation::{nearest_scaled_rows, relaxed_motion};
use crate::evidence::Observation;

/// The pose and shape of a car under weak perspective.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeakPerspective {
    /// Rotation from the car's frame to the camera's axes.
    pub camera_from_car: Matrix3<f64>,
    /// Scale for a camera of focal length 1, 1/m: the inverse of the depth.
    pub scale: f64,
    /// Weighted mean of the image points, for a camera of focal length 1.
    pub centre: Vector2<f64>,
    /// Shape coefficients, each divided by its sd over all cars.
    pub shape: Shape,
}

pub(super) fn solve(basis: &Basis, observations: &[Observation]) -> Option<WeakPerspective> {
    // With the means subtracted, the problem need not contain the translation.
    let centre = weighted_mean(&observations.iter().map(|s| s.ray).collect::<Vec<_>>(), observations).xy();
    let image: Vec<Vector2<f64>> = observations.iter().map(|s| s.xy() - centre).collect();
    let basis = basis.centred(observations);
    let mut points = basis.mean.clone();
    let (mut square, mut cross) = (Matrix3::zeros(), Matrix2x3::zeros());
    for ((x, w), s) in points.iter().zip(&image).zip(observations) {
        square += x * x.transpose() * s.weight;
        cross += w * x.transpose() * s.weight;
    }
    let (rows, mut scale) = nearest_scaled_rows(&relaxed_motion(&square, &cross)?)?;
    let (first, second) = (rows.row(0).transpose(), rows.row(1).transpose());
    let mut rotation =
        Matrix3::from_rows(&[first.transpose(), second.transpose(), first.cross(&second).transpose()]);
    let mut shape = Shape::zeros();
    let mut last_cost = f64::INFINITY;
    for _ in 0..MAX_ROUNDS {
        scale = best_scale(&rotation, &points, &image, observations)?;
        rotation = turned(&rotation, scale, &points, &image, observations)?;
        shape = best_shape(&basis, &rotation, scale, &image, observations)?;
        points = basis.shape(&shape);
        let cost = cost(&rotation, scale, &points, &image, observations, &shape);
        if last_cost - cost <= COST_TOLERANCE * cost {
            break;
        }
        last_cost = cost;
    }
    (scale.is_finite() && scale > 0.0).then_some(WeakPerspective {
        camera_from_car: rotation,
        scale,
        centre,
        shape,
    })
}

/// Returns the best scale for a given rotation and shape: a quotient of two sums.
fn best_scale(
    rotation: &Matrix3<f64>,
    points: &[Vector3<f64>],
    image: &[Vector2<f64>],
    observations: &[Observation],
) -> Option<f64> {
    let (mut cross, mut square) = (0.0, 0.0);
    for ((x, w), s) in points.iter().zip(image).zip(observations) {
        let seen = (rotation * x).xy();
        cross += s.weight * seen.dot(w);
        square += s.weight * seen.norm_squared();
    }
    let scale = cross / square;
    (scale.is_finite() && scale > 0.0).then_some(scale)
}

/// Returns a better rotation for a given scale and shape. The step is that of Green and Gower for two
/// orthonormal rows, here the first rows of the rotation (Gower & Dijksterhuis 2004, §5.1).
///
/// An image lacks the depths of the points. The current estimate supplies these depths, and the problem becomes a
/// Procrustes problem. Its solution cannot raise the cost. Pavlakos et al. solve the same sub-problem by optimisation
/// on the manifold.
fn turned(
    rotation: &Matrix3<f64>,
    scale: f64,
    points: &[Vector3<f64>],
    image: &[Vector2<f64>],
    observations: &[Observation],
) -> Option<Matrix3<f64>> {
    let mut cross = Matrix3::zeros();
    for ((x, w), s) in points.iter().zip(image).zip(observations) {
        let depth = scale * (rotation * x).z;
        cross += Vector3::new(w.x, w.y, depth) * x.transpose() * s.weight;
    }
    nearest_rotation(&cross)
}

/// Returns the best shape coefficients for a given rotation and scale, by ridge regression.
fn best_shape(
    basis: &Basis,
    rotation: &Matrix3<f64>,
    scale: f64,
    image: &[Vector2<f64>],
    observations: &[Observation],
) -> Option<Shape> {
    let mut normal = Matrix6::identity() * (KEYPOINT_SD_M * scale).powi(2);
    let mut right = Shape::zeros();
    for (i, s) in observations.iter().enumerate() {
        let columns: [Vector2<f64>; MODES] =
            std::array::from_fn(|j| (rotation * basis.modes[j][i]).xy() * scale);
        let off = image[i] - (rotation * basis.mean[i]).xy() * scale;
        for j in 0..MODES {
            right[j] += s.weight * columns[j].dot(&off);
            for k in 0..MODES {
                normal[(j, k)] += s.weight * columns[j].dot(&columns[k]);
            }
        }
    }
    Some(normal.cholesky()?.solve(&right))
}

fn cost(
    rotation: &Matrix3<f64>,
    scale: f64,
    points: &[Vector3<f64>],
    image: &[Vector2<f64>],
    observations: &[Observation],
    shape: &Shape,
) -> f64 {
    let off = |((x, w), s): ((&Vector3<f64>, &Vector2<f64>), &Observation)| {
        s.weight * (w - (rotation * x).xy() * scale).norm_squared()
    };
    let data: f64 = points.iter().zip(image).zip(observations).map(off).sum();
    0.5 * data + 0.5 * (KEYPOINT_SD_M * scale).powi(2) * shape.norm_squared()
}
