//! Prepares a window's evidence from cars for joining with a factor on the focal length.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, JointInformation};

use crate::WindowEstimate;

/// Returns a window that is linearised again at the camera `at`, to be joined with a factor on the focal length.
///
/// The evidence from cars is nearly a Gaussian in (log focal length, horizon, roll, log height), but not in the tilt.
/// Along the horizon, `focal · tan(tilt)`, focal length and tilt can trade off far from the camera of the solve.
///
/// `at` is the camera to which the join leads. A window that cannot be transformed is returned unchanged.
#[must_use]
pub fn beside_a_witness(window: &WindowEstimate, at: &CameraParams) -> WindowEstimate {
    let by = by_horizon(at);
    let (Some(back), Some(back_at)) = (by_horizon(&window.params).try_inverse(), by.try_inverse()) else {
        return window.clone();
    };
    let params = at.to_vector() - back_at * (with_horizon(at) - with_horizon(&window.params));
    let turn = back * by;
    let information = turn.transpose() * window.joint.information * turn;
    let information = 0.5 * (information + information.transpose());
    let joint = JointInformation {
        cross: turn.transpose() * window.joint.cross,
        ..JointInformation::of_camera(&information, &params)
    };
    WindowEstimate { params: CameraParams::from_vector(&params), solved: *at, joint, ..window.clone() }
}

/// Returns (log focal length, horizon, roll, log height); the horizon is its distance from the principal point, px.
fn with_horizon(params: &CameraParams) -> Vector4<f64> {
    let mut vector = params.to_vector();
    vector[1] = params.focal_px() * params.tilt.tan();
    vector
}

/// Returns the 4 × 4 derivative of `with_horizon` by (log focal length, tilt, roll, log height).
fn by_horizon(params: &CameraParams) -> Matrix4<f64> {
    let mut by = Matrix4::identity();
    by[(1, 0)] = params.focal_px() * params.tilt.tan();
    by[(1, 1)] = params.focal_px() / params.tilt.cos().powi(2);
    by
}
