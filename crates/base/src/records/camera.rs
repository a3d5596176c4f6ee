//! The estimated camera of one time segment, in which the camera is not moved.

use nalgebra::{Matrix4, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Camera, CameraParams, ImageSize, Lens};

/// The source of a camera's focal length and ground plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraStatus {
    /// The focal length and the ground plane are both estimated from the cars.
    Estimated,
    /// The user gave the focal length. The ground plane is estimated from the cars.
    FocalGiven,
    /// The cars constrain the focal length too weakly, so its value comes mainly from the prior. The ground plane is
    /// estimated from the cars.
    FocalFromPrior,
    /// No camera could be estimated. All values and their wide sds come from the prior.
    Unobservable,
}

/// The estimated camera of one time segment, with its uncertainty.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraEstimate {
    /// First and last presentation time of the segment, s.
    pub span_s: [f64; 2],
    /// Width and height of the frames, px.
    pub image_size_px: ImageSize,
    /// Principal point, px.
    pub principal_point_px: Vector2<f64>,
    /// Radial distortion of the lens.
    pub lens: Lens,
    /// Sd of the distortion ([`Lens::distortion`]), without unit.
    ///
    /// It is `None` if the picture did not show the distortion. The lens is then assumed to have no distortion.
    /// `covariance` includes the effect of this sd on the other parameters.
    pub distortion_sd: Option<f64>,
    /// Focal length, tilt, roll and height.
    pub params: CameraParams,
    /// Covariance of (log focal, tilt, roll, log height).
    pub covariance: Matrix4<f64>,
    /// Source of the focal length and the ground plane.
    pub status: CameraStatus,
    /// Number of different cars used for the estimate.
    pub cars_used: usize,
    /// Number of frames used for the estimate.
    pub frames_used: usize,
}

impl CameraEstimate {
    /// Returns the camera without its uncertainty.
    #[must_use]
    pub fn camera(&self) -> Camera {
        Camera {
            focal_px: self.params.focal_px(),
            principal_point_px: self.principal_point_px,
            lens: self.lens,
        }
    }
}
