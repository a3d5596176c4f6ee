//! The prior of a camera's four numbers.

use nalgebra::Vector4;
use roadplane_base::CameraParams;

/// A Gaussian prior of a camera, before any car is observed.
#[derive(Clone, Copy, Debug)]
pub struct FusePrior {
    /// Mean of the prior.
    pub params: CameraParams,
    /// Sds of log focal length, tilt (rad), roll (rad) and log height.
    pub sd: Vector4<f64>,
}
