//! The input of the systems for a frame, and their answers.

use nalgebra::{Isometry3, Matrix4};
use roadplane_base::{GroundPlane, ImageSize, KeypointSet, Shape};

use roadplane_metrics::camera::{CameraError, camera_error};

/// The input that every system gets for a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// Size of the picture; the principal point is its middle.
    pub size: ImageSize,
    /// The true focal length, for the systems that are given it, px.
    pub focal_px: f64,
    /// The true ground, only for [`System::ConstrainedGround`](super::System::ConstrainedGround).
    pub plane: GroundPlane,
    /// The keypoints of each car.
    pub cars: &'a [KeypointSet],
}

/// A car's pose and shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarAnswer {
    /// Rigid motion from the car's frame to the camera's frame.
    pub camera_from_car: Isometry3<f64>,
    /// Shape coefficients, each in units of its sd over all cars.
    pub shape: Shape,
}

/// A camera that a system found or was given, and the ground that it found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraAnswer {
    /// Focal length, px.
    pub focal_px: f64,
    /// The ground plane.
    pub plane: GroundPlane,
    /// Claimed covariance of (log f, tilt, roll, log h); zero for given values.
    pub covariance: Matrix4<f64>,
}

impl CameraAnswer {
    /// Returns the errors against the true focal length (px) and ground.
    #[must_use]
    pub fn error(&self, true_focal_px: f64, true_plane: &GroundPlane) -> CameraError {
        camera_error(self.focal_px, &self.plane, true_focal_px, true_plane).against_claimed(&self.covariance)
    }
}

/// The answer of a system for a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameAnswer {
    /// The answer for each car of the input; `None` if the system found no pose.
    pub cars: Vec<Option<CarAnswer>>,
    /// The camera, from systems that find the ground; `None` if they could not.
    pub camera: Option<CameraAnswer>,
}
