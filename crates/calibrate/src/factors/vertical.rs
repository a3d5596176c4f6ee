//! The vanishing point of the scene's vertical lines, such as masts and edges of houses.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2, Vector4};
use roadplane_base::CameraParams;

use super::residual::Component;

/// The vanishing point of vertical lines.
///
/// At the pixel p, a vertical line has the image direction `(sin roll, −cos roll) + inverse_distance · p`. The road need
/// not be level. The angle between its normal and the vertical has the sd [`SLOPE_SD`](Self::SLOPE_SD). For steep roads,
/// whose share is [`STEEP_SHARE`](Self::STEEP_SHARE), the sd is [`STEEP_SD`](Self::STEEP_SD).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VerticalVanishingPoint {
    /// One over the distance between the vanishing point and the principal point, 1/px: tan(tilt) / focal length.
    pub inverse_distance: f64,
    /// Clockwise turn of the horizon in the image, rad.
    pub roll: f64,
    /// Covariance of (`inverse_distance`, `roll`).
    pub covariance: Matrix2<f64>,
}

impl VerticalVanishingPoint {
    /// Sd of the slope of roads and parking lots, along and across the road, rad.
    ///
    /// The three numbers on slopes were chosen on calibrated real cameras and confirmed on rendered ones
    /// (`docs/book/science.md`, "Vertical lines").
    pub const SLOPE_SD: f64 = 0.0175;
    /// Sd of the slope of steep streets, along and across the road, rad.
    pub const STEEP_SD: f64 = 0.087;
    /// Share of steep streets, 0–1.
    pub const STEEP_SHARE: f64 = 0.3;

    /// Returns the error, with the components of a nearly level and of a steep street.
    pub(super) fn error(&self, camera: &Vector4<f64>) -> Option<(DVector<f64>, Vec<Component>)> {
        let params = CameraParams::from_vector(camera);
        let expected = params.tilt.tan() / params.focal_px();
        let value = DVector::from_column_slice(&[self.inverse_distance - expected, self.roll - params.roll]);
        let cos = params.tilt.cos();
        let sloped = |slope_sd: f64, share: f64| {
            let of_slope = Vector2::new(1.0 / (cos * cos * params.focal_px()), 1.0 / cos) * slope_sd;
            let covariance = self.covariance + Matrix2::from_diagonal(&of_slope.component_mul(&of_slope));
            let information = covariance.try_inverse()?;
            Some(Component { share, information: DMatrix::from_column_slice(2, 2, information.as_slice()) })
        };
        let steep = Self::STEEP_SHARE;
        Some((value, vec![sloped(Self::SLOPE_SD, 1.0 - steep)?, sloped(Self::STEEP_SD, steep)?]))
    }
}
