//! The coordinates in which the evidence of cars is nearly a Gaussian: (log f, horizon, roll, log h').
//!
//! The horizon `f · tan(tilt)` is its distance from the principal point, px. Cars determine it well. Focal length and
//! tilt can trade off along the horizon, far from the camera at which a window was solved.

use nalgebra::{Matrix4, Vector4};

use super::evidence::Evidence;

/// Converts (log f, tilt, roll, log h') to (log f, horizon, roll, log h').
fn with_horizon(camera: &Vector4<f64>) -> Vector4<f64> {
    let mut vector = *camera;
    vector[1] = camera[0].exp() * camera[1].tan();
    vector
}

/// Returns the 4 × 4 derivative of [`with_horizon`].
fn by_camera(camera: &Vector4<f64>) -> Matrix4<f64> {
    let focal_px = camera[0].exp();
    let mut by = Matrix4::identity();
    by[(1, 0)] = focal_px * camera[1].tan();
    by[(1, 1)] = focal_px / camera[1].cos().powi(2);
    by
}

/// Converts evidence on (log f, tilt, roll, log h') that was linearised at `camera` to evidence on (log f, horizon,
/// roll, log h'). `None` where the tilt is a right angle.
pub(super) fn of_horizon(evidence: &Evidence, camera: &Vector4<f64>) -> Option<Evidence> {
    Some(evidence.moved(&by_camera(camera).try_inverse()?, camera, &with_horizon(camera)))
}

/// Converts evidence on (log f, horizon, roll, log h') to (log f, tilt, roll, log h'), linearised at `camera`.
pub(super) fn linearised(of_horizon: &Evidence, camera: &Vector4<f64>) -> Evidence {
    of_horizon.moved(&by_camera(camera), &with_horizon(camera), camera)
}
