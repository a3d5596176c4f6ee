//! The camera and the ground plane of a frame.

use roadplane_base::{Camera, CameraEstimate, GroundPlane};

/// The camera and the ground plane of a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameCamera {
    /// Camera with its lens.
    pub camera: Camera,
    /// Ground plane in the camera frame.
    pub plane: GroundPlane,
}

impl From<&CameraEstimate> for FrameCamera {
    fn from(estimate: &CameraEstimate) -> Self {
        let camera = estimate.camera();
        Self { camera, plane: estimate.params.plane() }
    }
}
