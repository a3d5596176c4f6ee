//! The coordinates in which the evidence of cars is nearly a Gaussian: (log f, horizon, roll, log h').
//!
//! The horizon `f · tan(tilt)` is its distance from the principal point, px. Cars determine it well. Focal length and
//! tilt can trade off along the horizon, far from the camera at which a window was solved.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::JointInformation;

use super::evidence::Evidence;
use crate::WindowEstimate;

/// Converts (log f, tilt, roll, log h') to (log f, horizon, roll, log h').
pub(super) fn with_horizon(camera: &Vector4<f64>) -> Vector4<f64> {
    let mut vector = *camera;
    vector[1] = camera[0].exp() * camera[1].tan();
    vector
}

/// Converts (log f, horizon, roll, log h') to (log f, tilt, roll, log h').
pub(super) fn with_tilt(vector: &Vector4<f64>) -> Vector4<f64> {
    let mut camera = *vector;
    camera[1] = (vector[1] / vector[0].exp()).atan();
    camera
}

/// Returns the 4 × 4 derivative of [`with_horizon`].
pub(super) fn by_camera(camera: &Vector4<f64>) -> Matrix4<f64> {
    let focal_px = camera[0].exp();
    let mut by = Matrix4::identity();
    by[(1, 0)] = focal_px * camera[1].tan();
    by[(1, 1)] = focal_px / camera[1].cos().powi(2);
    by
}

/// Converts joint information on (log f, tilt, roll, log h') that was linearised at `camera`.
///
/// `None` where the tilt is a right angle.
pub(super) fn information_with_horizon(
    joint: &JointInformation,
    camera: &Vector4<f64>,
) -> Option<JointInformation> {
    let back = by_camera(camera).try_inverse()?;
    let information = back.transpose() * joint.information * back;
    let information = (information + information.transpose()) / 2.0;
    let away = joint.vector - joint.information * camera;
    Some(JointInformation {
        information,
        cross: back.transpose() * joint.cross,
        vector: information * with_horizon(camera) + back.transpose() * away,
    })
}

/// Converts joint information on (log f, horizon, roll, log h') to (log f, tilt, roll, log h'), linearised at `camera`.
pub(super) fn information_with_tilt(joint: &JointInformation, camera: &Vector4<f64>) -> JointInformation {
    let by = by_camera(camera);
    let Evidence { information, weighted } =
        Evidence { information: joint.information, weighted: joint.vector }.linearised(camera);
    JointInformation { information, cross: by.transpose() * joint.cross, vector: weighted }
}

/// A window with its evidence in these coordinates.
pub(super) struct Seen<'a> {
    /// The window.
    pub window: &'a WindowEstimate,
    /// Its estimate.
    pub mean: Vector4<f64>,
    /// Its evidence.
    pub joint: JointInformation,
}

impl<'a> Seen<'a> {
    /// Converts a window. `None` if its numbers are not finite or its information is negative.
    pub(super) fn of(window: &'a WindowEstimate) -> Option<Self> {
        let camera = window.params.to_vector();
        let joint = information_with_horizon(&window.joint, &camera)?;
        let mean = with_horizon(&camera);
        let finite = mean.iter().chain(joint.vector.iter()).chain(&window.span_s).all(|x| x.is_finite())
            && joint.information.iter().chain(joint.cross.iter()).all(|x| x.is_finite());
        (finite && window.joint.information.diagonal().min() >= 0.0).then_some(Self { window, mean, joint })
    }
}

impl Evidence {
    /// Converts evidence on (log f, horizon, roll, log h') to (log f, tilt, roll, log h'), linearised at `camera`.
    pub(super) fn linearised(&self, camera: &Vector4<f64>) -> Self {
        let by = by_camera(camera);
        let information = by.transpose() * self.information * by;
        let information = (information + information.transpose()) / 2.0;
        let pull = by.transpose() * (self.weighted - self.information * with_horizon(camera));
        Self { information, weighted: information * camera + pull }
    }
}
