//! The input that every system gets for a frame, and the answer that a system returns.

use nalgebra::{Isometry3, Matrix4};
use roadplane_base::{GroundPlane, ImageSize, KeypointSet, Shape};

use roadplane_metrics::camera::{CameraError, camera_error};

/// The input that every system gets for a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// Size of the picture, px. The systems take the picture's middle as the principal point.
    pub size: ImageSize,
    /// True focal length, px. Systems that estimate the focal length ignore this value.
    pub focal_px: f64,
    /// True ground plane. Only [`System::ConstrainedGround`](super::System::ConstrainedGround) uses this value.
    pub plane: GroundPlane,
    /// The keypoints of each car.
    pub cars: &'a [KeypointSet],
}

/// The pose and shape that a system estimates for a car.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarAnswer {
    /// Rigid motion from the car's frame to the camera's frame.
    pub camera_from_car: Isometry3<f64>,
    /// Shape coefficients. The unit of each coefficient is its standard deviation over all cars.
    pub shape: Shape,
}

/// The camera and the ground plane that a system estimates. The focal length may be a given value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraAnswer {
    /// Focal length, px.
    pub focal_px: f64,
    /// The ground plane.
    pub plane: GroundPlane,
    /// Covariance that the system reports for (log f, tilt, roll, log h), where f is the focal length (px) and h the
    /// camera's height (m). Angles are in rad. Entries of given values are zero.
    pub covariance: Matrix4<f64>,
}

impl CameraAnswer {
    /// Returns the errors of this camera against the true focal length (px) and the true ground plane.
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
    /// The estimated camera. `None` if the system estimates no ground plane, or found none in this frame.
    pub camera: Option<CameraAnswer>,
}
