//! The estimated camera of one time segment, in which the camera is not moved.

use nalgebra::{Matrix4, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Camera, CameraParams, Ground, GroundPart, ImageSize, Lens};

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
    /// The plane beyond a fold of the ground; `None` if the ground is one plane.
    pub second_plane: Option<SecondPlane>,
}

/// The plane of the ground beyond a fold, as the camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondPlane {
    /// Focal length as above the first plane; tilt, roll and height above this plane.
    pub params: CameraParams,
    /// Covariance of (log focal, tilt, roll, log height).
    pub covariance: Matrix4<f64>,
    /// Whether the ground lies above the first plane beyond the fold.
    pub rises: bool,
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

    /// Returns the camera above one plane of the ground, with this plane alone.
    #[must_use]
    pub fn above(&self, part: &GroundPart) -> Self {
        let second = self.second_plane.filter(|_| part.index > 0);
        let alone = Self { second_plane: None, ..self.clone() };
        match second {
            Some(SecondPlane { params, covariance, .. }) => Self { params, covariance, ..alone },
            None => alone,
        }
    }

    /// Returns the angle between the two planes of the ground, rad: positive if the ground rises beyond the fold. Returns
    /// `None` if the ground is one plane.
    #[must_use]
    pub fn slope_rad(&self) -> Option<f64> {
        let second = self.second_plane?;
        let normals = [self.params, second.params].map(|params| params.plane().normal_in_camera);
        let angle = normals[0].angle(&normals[1]);
        Some(if second.rises { angle } else { -angle })
    }

    /// Returns the ground below the camera. Parallel planes count as one.
    #[must_use]
    pub fn ground(&self) -> Ground {
        let first = self.params.plane();
        let folded =
            self.second_plane.and_then(|second| Ground::folded(first, second.params.plane(), second.rises));
        folded.unwrap_or(Ground::plane(first))
    }
}
