//! What systems get of a frame, and what they say of it.

use nalgebra::{Isometry3, Matrix4};
use roadplane_base::{GroundPlane, ImageSize, KeypointSet, Shape};

use roadplane_metrics::camera::{CameraError, camera_error};

/// What every system gets of a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// Size of the picture; the principal point is its middle.
    pub size: ImageSize,
    /// The true focal length, for the systems that take it as known, px.
    pub focal_px: f64,
    /// The true ground, for [`System::ConstrainedGround`](super::System::ConstrainedGround) alone.
    pub plane: GroundPlane,
    /// Keypoints of each car.
    pub cars: &'a [KeypointSet],
}

/// A car's pose and shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarAnswer {
    /// Rigid motion from the car's to the camera's frame.
    pub camera_from_car: Isometry3<f64>,
    /// Shape coefficients, each in units of its sd over all cars.
    pub shape: Shape,
}

/// A camera that a system found or was given, and the ground that it found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraAnswer {
    /// Focal length, px.
    pub focal_px: f64,
    /// The ground.
    pub plane: GroundPlane,
    /// Claimed, of (log f, tilt, roll, log h); zero where given.
    pub covariance: Matrix4<f64>,
}

impl CameraAnswer {
    /// Its errors against the true focal length (px) and ground.
    #[must_use]
    pub fn error(&self, true_focal_px: f64, true_plane: &GroundPlane) -> CameraError {
        camera_error(self.focal_px, &self.plane, true_focal_px, true_plane).against_claimed(&self.covariance)
    }
}

/// What a system says of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameAnswer {
    /// Per car of the input; `None` where it found no pose.
    pub cars: Vec<Option<CarAnswer>>,
    /// Of the systems that find the ground, unless they could not.
    pub camera: Option<CameraAnswer>,
}
