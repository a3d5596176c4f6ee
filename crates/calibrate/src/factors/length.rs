//! A known distance between two pixels on the ground.

use nalgebra::{DMatrix, DVector, Vector2, Vector4};
use roadplane_base::{Camera, CameraParams};

use super::residual::Component;

/// A known distance between two pixels on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Length {
    /// Both ends, undistorted and relative to the principal point, px.
    pub ends_px: [Vector2<f64>; 2],
    /// Sd of each coordinate of the ends, px.
    pub end_sd_px: f64,
    /// Length, m, above 0.
    pub length_m: f64,
    /// Sd of the length, as a share of the length.
    pub log_sd: f64,
}

impl Length {
    /// Returns the length that a camera (log f, tilt, roll, log h) measures between the two pixels, m, and a relative sd.
    ///
    /// The sd combines the errors of the given length and of the pixels. Returns `None` if a pixel lies above the
    /// horizon.
    #[must_use]
    pub fn measured(&self, camera: &Vector4<f64>) -> Option<(f64, f64)> {
        let params = CameraParams::from_vector(camera);
        let (pinhole, plane) = (Camera::pinhole(params.focal_px(), Vector2::zeros()), params.plane());
        let ground = |pixel: &Vector2<f64>| plane.world_from_pixel(&pinhole, pixel);
        let [a, b] = [ground(&self.ends_px[0])?, ground(&self.ends_px[1])?];
        let length = (a - b).norm();
        let mut variance = self.log_sd * self.log_sd;
        for (end, (other, here)) in self.ends_px.iter().zip([(b, a), (a, b)]) {
            for axis in [Vector2::x(), Vector2::y()] {
                let moved = ground(&(end + axis))?;
                let change = (moved - here).dot(&(here - other)) / (length * length);
                variance += (change * self.end_sd_px).powi(2);
            }
        }
        Some((length, variance.sqrt()))
    }

    /// Returns the log of the given over the measured length.
    pub(super) fn error(&self, camera: &Vector4<f64>) -> Option<(DVector<f64>, Vec<Component>)> {
        let (length, log_sd) = self.measured(camera)?;
        let value = DVector::from_element(1, (self.length_m / length).ln());
        let component = Component { share: 1.0, information: DMatrix::from_element(1, 1, log_sd.powi(-2)) };
        value[0].is_finite().then(|| (value, vec![component]))
    }
}
