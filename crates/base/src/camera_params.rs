//! Camera and ground plane as the four numbers that a solver estimates.

use nalgebra::Vector4;

use crate::GroundPlane;

/// Camera and ground plane as four numbers, in this order: log focal (px), tilt, roll (rad), log height (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraParams {
    /// Natural logarithm of the focal length in px.
    pub log_focal: f64,
    /// Angle of the optical axis below the horizontal, rad.
    pub tilt: f64,
    /// Clockwise turn of the horizon in the image, rad.
    pub roll: f64,
    /// Natural logarithm of the camera's height above the plane in m.
    pub log_height: f64,
}

impl CameraParams {
    /// Returns the vector (log focal, tilt, roll, log height).
    #[must_use]
    pub fn to_vector(self) -> Vector4<f64> {
        Vector4::new(self.log_focal, self.tilt, self.roll, self.log_height)
    }

    /// Creates the parameters from a vector (log focal, tilt, roll, log height).
    #[must_use]
    pub fn from_vector(v: &Vector4<f64>) -> Self {
        Self { log_focal: v[0], tilt: v[1], roll: v[2], log_height: v[3] }
    }

    /// Returns the focal length, px.
    #[must_use]
    pub fn focal_px(&self) -> f64 {
        self.log_focal.exp()
    }

    /// Returns the ground plane.
    #[must_use]
    pub fn plane(&self) -> GroundPlane {
        GroundPlane::from_tilt_roll_height(self.tilt, self.roll, self.log_height.exp())
    }

    /// Creates the parameters from a focal length (px) and a ground plane.
    #[must_use]
    pub fn new(focal_px: f64, plane: &GroundPlane) -> Self {
        Self {
            log_focal: focal_px.ln(),
            tilt: plane.tilt(),
            roll: plane.roll(),
            log_height: plane.height_m.ln(),
        }
    }
}
