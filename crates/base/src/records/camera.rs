//! The camera over a stretch of time.

use nalgebra::{Matrix4, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Camera, CameraParams, ImageSize, Lens};

/// How a camera's numbers came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraStatus {
    /// Focal length and plane both estimated from the cars.
    Estimated,
    /// The focal length was given, the plane is estimated.
    FocalGiven,
    /// The cars say too little of the focal length: it rests on the stated prior; the plane is estimated.
    FocalFromPrior,
    /// No camera could be estimated; numbers are the priors, with their wide sd.
    Unobservable,
}

/// A camera over a stretch of time, with uncertainty.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraEstimate {
    /// First and last presentation time that this holds for, s.
    pub span_s: [f64; 2],
    /// Size of the pictures.
    pub image_size_px: ImageSize,
    /// Principal point, px.
    pub principal_point_px: Vector2<f64>,
    /// How the lens bends lines.
    pub lens: Lens,
    /// sd of its bend ([`Lens::bend`]); `None` where the picture did not show it and it is taken for straight. What it does to the
    /// other numbers is in their covariance.
    pub bend_sd: Option<f64>,
    /// Focal length, tilt, roll, height.
    pub params: CameraParams,
    /// Covariance of (log focal, tilt, roll, log height).
    pub covariance: Matrix4<f64>,
    /// How the numbers came about.
    pub status: CameraStatus,
    /// Different cars that were used.
    pub cars_used: usize,
    /// Frames that were used.
    pub frames_used: usize,
}

impl CameraEstimate {
    /// The camera itself.
    #[must_use]
    pub fn camera(&self) -> Camera {
        Camera {
            focal_px: self.params.focal_px(),
            principal_point_px: self.principal_point_px,
            lens: self.lens,
        }
    }
}
