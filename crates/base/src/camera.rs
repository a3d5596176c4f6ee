//! Camera with square pixels: a pinhole, and what the lens does to straight lines.

use nalgebra::{Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{GroundPlane, Lens};

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(into = "[u32; 2]", from = "[u32; 2]")]
pub struct ImageSize {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl From<[u32; 2]> for ImageSize {
    fn from([width, height]: [u32; 2]) -> Self {
        Self { width, height }
    }
}

impl From<ImageSize> for [u32; 2] {
    fn from(size: ImageSize) -> Self {
        [size.width, size.height]
    }
}

impl ImageSize {
    /// Middle of the image, px: where the principal point is taken to be when nobody knows it.
    #[must_use]
    pub fn centre_px(self) -> Vector2<f64> {
        Vector2::new((f64::from(self.width) - 1.0) / 2.0, (f64::from(self.height) - 1.0) / 2.0)
    }
}

/// `pixel = principal_point + lens(focal · (X/Z, Y/Z))` for a point (X, Y, Z) in the camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Focal length, px.
    pub focal_px: f64,
    /// Principal point, px; the lens bends around it, too.
    pub principal_point_px: Vector2<f64>,
    /// How the lens bends lines.
    pub lens: Lens,
}

impl Camera {
    /// How far the principal point is from the picture's middle (sd of each coordinate), as a share of the picture's width: 1.5 % is
    /// what calibrated surveillance cameras that are not cropped scatter by (MEVA, TUMTraf).
    pub const PRINCIPAL_POINT_SD: f64 = 0.015;

    /// A camera that bends no lines.
    #[must_use]
    pub fn pinhole(focal_px: f64, principal_point_px: Vector2<f64>) -> Self {
        Self { focal_px, principal_point_px, lens: Lens::STRAIGHT }
    }

    /// A camera that bends no lines and whose principal point is the middle of the image.
    #[must_use]
    pub fn centred(focal_px: f64, size: ImageSize) -> Self {
        Self::pinhole(focal_px, size.centre_px())
    }

    /// Pixel of a point in the camera frame; `None` at or behind the camera (z ≤ 1 mm).
    #[must_use]
    pub fn pixel_from_camera(&self, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
        (point_in_camera.z > 1e-3).then(|| {
            let straight = self.focal_px / point_in_camera.z * point_in_camera.xy();
            self.principal_point_px + self.lens.bent(&straight)
        })
    }

    /// Viewing ray of a pixel in the camera frame, scaled to z = 1.
    #[must_use]
    pub fn ray_from_pixel(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let xy = self.lens.straightened(&(pixel - self.principal_point_px)) / self.focal_px;
        Vector3::new(xy.x, xy.y, 1.0)
    }
}

/// Camera and plane in the four numbers that a clip's evidence is about, in this order:
/// log focal (px), tilt, roll (rad), log height (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraParams {
    /// Natural logarithm of the focal length in px.
    pub log_focal: f64,
    /// Optical axis below the horizontal, rad.
    pub tilt: f64,
    /// Clockwise turn of the horizon in the image, rad.
    pub roll: f64,
    /// Natural logarithm of the camera's height above the plane in m.
    pub log_height: f64,
}

impl CameraParams {
    /// As a vector (log focal, tilt, roll, log height).
    #[must_use]
    pub fn to_vector(self) -> nalgebra::Vector4<f64> {
        nalgebra::Vector4::new(self.log_focal, self.tilt, self.roll, self.log_height)
    }

    /// From a vector (log focal, tilt, roll, log height).
    #[must_use]
    pub fn from_vector(v: &nalgebra::Vector4<f64>) -> Self {
        Self { log_focal: v[0], tilt: v[1], roll: v[2], log_height: v[3] }
    }

    /// Focal length, px.
    #[must_use]
    pub fn focal_px(&self) -> f64 {
        self.log_focal.exp()
    }

    /// The plane part.
    #[must_use]
    pub fn plane(&self) -> GroundPlane {
        GroundPlane::from_tilt_roll_height(self.tilt, self.roll, self.log_height.exp())
    }

    /// Joins a focal length and a plane.
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
