//! A camera with square pixels: a pinhole with radial lens distortion.

use nalgebra::{Vector2, Vector3};

use crate::{ImageSize, Lens};

/// A pinhole camera with radial lens distortion.
///
/// A point (X, Y, Z) of the camera frame has the pixel `principal_point + lens(focal · (X/Z, Y/Z))`. The function
/// `lens` is [`Lens::distorted`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Focal length, px.
    pub focal_px: f64,
    /// Principal point, px. It is also the centre of the lens distortion.
    pub principal_point_px: Vector2<f64>,
    /// Radial distortion of the lens.
    pub lens: Lens,
}

impl Camera {
    /// Prior sd of each coordinate of the principal point, as a share of the image's width. The prior mean is the
    /// image's middle.
    ///
    /// The value of 1.5 % is the scatter of calibrated surveillance cameras whose images are not cropped (data sets
    /// MEVA and TUMTraf).
    pub const PRINCIPAL_POINT_SD: f64 = 0.015;

    /// Creates a camera without distortion.
    #[must_use]
    pub fn pinhole(focal_px: f64, principal_point_px: Vector2<f64>) -> Self {
        Self { focal_px, principal_point_px, lens: Lens::STRAIGHT }
    }

    /// Creates a camera without distortion whose principal point is the middle of the image.
    #[must_use]
    pub fn centred(focal_px: f64, size: ImageSize) -> Self {
        Self::pinhole(focal_px, size.centre_px())
    }

    /// Returns the pixel of a point in the camera frame.
    ///
    /// Returns `None` if the point is not in front of the camera (z ≤ 1 mm).
    #[must_use]
    pub fn pixel_from_camera(&self, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
        (point_in_camera.z > 1e-3).then(|| {
            let straight = self.focal_px / point_in_camera.z * point_in_camera.xy();
            self.principal_point_px + self.lens.distorted(&straight)
        })
    }

    /// Returns the viewing ray of a pixel in the camera frame, scaled to z = 1.
    #[must_use]
    pub fn ray_from_pixel(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let xy = self.lens.undistorted(&(pixel - self.principal_point_px)) / self.focal_px;
        Vector3::new(xy.x, xy.y, 1.0)
    }
}
