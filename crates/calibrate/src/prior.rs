//! The prior of a camera's four numbers.

use nalgebra::Vector4;
use roadplane_base::CameraParams;

/// Least sd of a number of the camera or of the cars' size, log or rad. It stands for exact numbers, and it keeps matrices
/// invertible.
pub const LEAST_SD: f64 = 1e-6;

/// A Gaussian prior of a camera, before any car is observed.
#[derive(Clone, Copy, Debug)]
pub struct FusePrior {
    /// Mean of the prior.
    pub params: CameraParams,
    /// Sds of log focal length, tilt (rad), roll (rad) and log height.
    pub sd: Vector4<f64>,
}
