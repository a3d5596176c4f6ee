//! The coordinates in which the evidence of cars is nearly a Gaussian: (log f, horizon, roll, log h').
//!
//! The horizon `f · tan(tilt)` is its distance from the principal point, px. Cars determine it well. Focal length and
//! tilt can trade off along the horizon, far from the camera at which a window was solved.

use nalgebra::{Matrix4, Vector4};

use super::evidence::Evidence;

/// Evidence of cars: a Gaussian of (log f, horizon, roll, log h').
#[derive(Clone, Copy, Debug)]
pub(super) struct CarEvidence {
    /// Inverse covariance.
    information: Matrix4<f64>,
    /// Inverse covariance times the mean.
    weighted: Vector4<f64>,
}

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

impl CarEvidence {
    /// Returns evidence without information.
    pub(super) fn none() -> Self {
        Self { information: Matrix4::zeros(), weighted: Vector4::zeros() }
    }

    /// Converts evidence on (log f, tilt, roll, log h') that was linearised at `camera`. `None` where the tilt is a right
    /// angle.
    pub(super) fn of(evidence: &Evidence, camera: &Vector4<f64>) -> Option<Self> {
        let back = by_camera(camera).try_inverse()?;
        let information = back.transpose() * evidence.information * back;
        let information = (information + information.transpose()) / 2.0;
        let pull = back.transpose() * (evidence.weighted - evidence.information * camera);
        Some(Self { information, weighted: information * with_horizon(camera) + pull })
    }

    /// Converts the evidence to (log f, tilt, roll, log h'), linearised at `camera`.
    pub(super) fn linearised(&self, camera: &Vector4<f64>) -> Evidence {
        let by = by_camera(camera);
        let information = by.transpose() * self.information * by;
        let information = (information + information.transpose()) / 2.0;
        let pull = by.transpose() * (self.weighted - self.information * with_horizon(camera));
        Evidence { information, weighted: information * camera + pull }
    }
}
