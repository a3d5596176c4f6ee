//! What cars say of a camera where there is another witness for the focal length.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, JointInformation};

use crate::WindowEstimate;

/// A window as it is to be joined with a witness for the focal length, linearised at the camera `at`, where the join leads.
///
/// What cars say is nearly a Gaussian in (log focal, horizon, roll, log height), not in tilt: along the horizon, `focal · tan(tilt)`,
/// focal length and tilt trade against each other far from where a window was solved.
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

/// (log focal, horizon in px, roll, log height).
fn with_horizon(params: &CameraParams) -> Vector4<f64> {
    let mut vector = params.to_vector();
    vector[1] = params.focal_px() * params.tilt.tan();
    vector
}

/// Its derivative by (log focal, tilt, roll, log height).
fn by_horizon(params: &CameraParams) -> Matrix4<f64> {
    let mut by = Matrix4::identity();
    by[(1, 0)] = params.focal_px() * params.tilt.tan();
    by[(1, 1)] = params.focal_px() / params.tilt.cos().powi(2);
    by
}
