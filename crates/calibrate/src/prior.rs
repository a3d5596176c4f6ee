//! What is believed beforehand.

use nalgebra::Vector4;
use roadplane_base::CameraParams;

/// What is believed of a camera before any car was seen.
#[derive(Clone, Copy, Debug)]
pub struct FusePrior {
    /// Middle.
    pub params: CameraParams,
    /// sd of log focal, tilt, roll, log height.
    pub sd: Vector4<f64>,
}
