//! What cars say of a camera where there is another witness for the focal length.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::CameraParams;

use crate::WindowEstimate;
use crate::verticals::SHARED_FOCAL_SD;

/// A window as it is to be joined with a witness for the focal length, linearised at the camera `at`, where the join leads.
///
/// What cars say is nearly a Gaussian in (log focal, horizon, roll, log height), not in tilt: along the horizon, `focal · tan(tilt)`,
/// focal length and tilt trade against each other far from where a window was solved. And cars share an error along it
/// ([`SHARED_FOCAL_SD`]) that their own information does not hold; whoever joins the window divides its information by
/// `dispersion`, which that error is spared.
#[must_use]
pub fn beside_a_witness(window: &WindowEstimate, at: &CameraParams, dispersion: f64) -> WindowEstimate {
    let Some(back) = by_horizon(&window.params).try_inverse() else { return window.clone() };
    let information = back.transpose() * window.information * back;
    let focal = information.column(0).into_owned();
    let loose = dispersion / (SHARED_FOCAL_SD * SHARED_FOCAL_SD);
    let information = information - focal * focal.transpose() / (loose + focal[0]);
    let by = by_horizon(at);
    let Some(back) = by.try_inverse() else { return window.clone() };
    let information = by.transpose() * information * by;
    let params = at.to_vector() - back * (with_horizon(at) - with_horizon(&window.params));
    WindowEstimate {
        params: CameraParams::from_vector(&params),
        solved: *at,
        information: 0.5 * (information + information.transpose()),
        ..window.clone()
    }
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
