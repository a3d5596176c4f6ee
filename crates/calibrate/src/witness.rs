//! What cars say of a camera where there is another witness for the focal length.

use nalgebra::{Matrix4, Matrix6, Vector4, Vector6};
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
    let mut turn = Matrix6::identity();
    turn.fixed_view_mut::<4, 4>(0, 0).copy_from(&(back * by));
    let information = turn.transpose() * window.joint.information * turn;
    let gradient = window.joint.information * on(&window.params.to_vector()) - window.joint.vector;
    let vector = information * on(&params) - turn.transpose() * gradient;
    WindowEstimate {
        params: CameraParams::from_vector(&params),
        solved: *at,
        joint: JointInformation { information: 0.5 * (information + information.transpose()), vector },
        ..window.clone()
    }
}

/// A camera, shared errors 0.
fn on(camera: &Vector4<f64>) -> Vector6<f64> {
    let mut all = Vector6::zeros();
    all.fixed_rows_mut::<4>(0).copy_from(camera);
    all
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
