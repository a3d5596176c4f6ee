//! Radial lens distortion.

use nalgebra::{Matrix2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ImageSize;

/// Radial distortion by the division model (Fitzgibbon, CVPR 2001).
///
/// Let p be the pixel of a scene point, relative to the principal point. A lens without distortion would show the point
/// at `p / (1 + per_px2 · |p|²)`. The model is in pixels, so it needs no focal length. Barrel distortion has a negative
/// coefficient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Lens {
    /// Coefficient of the division model, 1/px².
    pub per_px2: f64,
}

/// Number of radii at which two distortion models are compared.
const STEPS: i32 = 50;
/// Lower limit of the model's divisor. At the radii of real pictures, the divisor is larger.
const LEAST_DIVISOR: f64 = 0.1;

impl Lens {
    /// A lens without distortion: straight lines stay straight.
    pub const STRAIGHT: Self = Self { per_px2: 0.0 };

    /// Creates a lens from its distortion at half the image's width, as [`Lens::distortion`] returns it.
    #[must_use]
    pub fn with_distortion(distortion: f64, size: ImageSize) -> Self {
        Self { per_px2: distortion / half_width_px(size).powi(2) }
    }

    /// Returns the distortion at half the image's width: `per_px2 · (width / 2)²`, without unit.
    #[must_use]
    pub fn distortion(self, size: ImageSize) -> f64 {
        self.per_px2 * half_width_px(size).powi(2)
    }

    /// Creates the lens that is most similar to OpenCV's distortion coefficients `k1` and `k2`.
    ///
    /// `focal_px` is the focal length, px. The fit is by least squares over the radii from 0 to half of the image's
    /// diagonal.
    #[must_use]
    pub fn from_opencv(k1: f64, k2: f64, focal_px: f64, size: ImageSize) -> Self {
        let reach = size.centre_px().norm() / focal_px;
        // Let r be the undistorted radius, r_d the distorted one, f the focal length and λ the wanted `per_px2`. The
        // division model r_d (1 + λ f² r_d²)⁻¹ = r is linear in λ.
        let (mut sum, mut weight) = (0.0, 0.0);
        for step in 1..=STEPS {
            let straight = reach * f64::from(step) / f64::from(STEPS);
            let square = straight * straight;
            let distorted = straight * (1.0 + k1 * square + k2 * square * square);
            // From the radius at which the polynomial begins to decrease, it does not describe a lens.
            if 1.0 + 3.0 * k1 * square + 5.0 * k2 * square * square <= 0.0 {
                break;
            }
            let by_lens = straight * (focal_px * distorted).powi(2);
            sum += by_lens * (distorted - straight);
            weight += by_lens * by_lens;
        }
        Self { per_px2: if weight > 0.0 { sum / weight } else { 0.0 } }
    }

    /// Returns OpenCV's distortion coefficients `[k1, k2]` that are most similar to this lens.
    ///
    /// `focal_px` is the focal length, px. The fit is by least squares over the radii from 0 to half of the image's
    /// diagonal.
    #[must_use]
    pub fn opencv(self, focal_px: f64, size: ImageSize) -> [f64; 2] {
        let reach = size.centre_px().norm();
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for step in 1..=STEPS {
            let distorted = Vector2::new(reach * f64::from(step) / f64::from(STEPS), 0.0);
            let straight = self.undistorted(&distorted).x / focal_px;
            let by = Vector2::new(straight.powi(3), straight.powi(5));
            normal += by * by.transpose();
            right += by * (distorted.x / focal_px - straight);
        }
        normal.try_inverse().map_or([0.0; 2], |inverse| (inverse * right).into())
    }

    /// Returns the undistorted position of a pixel. Both positions are relative to the principal point, px.
    #[must_use]
    pub fn undistorted(self, distorted: &Vector2<f64>) -> Vector2<f64> {
        distorted / self.divisor(distorted)
    }

    /// Returns the pixel at which this lens shows an undistorted position.
    ///
    /// Both positions are relative to the principal point, px.
    #[must_use]
    pub fn distorted(self, straight: &Vector2<f64>) -> Vector2<f64> {
        let root = (1.0 - 4.0 * self.per_px2 * straight.norm_squared()).max(0.0).sqrt();
        straight * (2.0 / (1.0 + root))
    }

    /// Returns the derivative of [`Lens::undistorted`] with respect to the pixel.
    #[must_use]
    pub fn undistorted_by_pixel(self, distorted: &Vector2<f64>) -> Matrix2<f64> {
        let divisor = self.divisor(distorted);
        (Matrix2::identity() - distorted * distorted.transpose() * (2.0 * self.per_px2 / divisor)) / divisor
    }

    /// Returns the derivative of [`Lens::undistorted`] with respect to `per_px2`, px³.
    #[must_use]
    pub fn undistorted_by_lens(self, distorted: &Vector2<f64>) -> Vector2<f64> {
        -distorted * (distorted.norm_squared() / self.divisor(distorted).powi(2))
    }

    fn divisor(self, distorted: &Vector2<f64>) -> f64 {
        (1.0 + self.per_px2 * distorted.norm_squared()).max(LEAST_DIVISOR)
    }
}

fn half_width_px(size: ImageSize) -> f64 {
    0.5 * f64::from(size.width.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: ImageSize = ImageSize { width: 1920, height: 1080 };

    #[test]
    fn distorting_inverts_undistorting() {
        for distortion in [-0.3, -0.05, 0.0, 0.05] {
            let lens = Lens::with_distortion(distortion, SIZE);
            assert!((lens.distortion(SIZE) - distortion).abs() < 1e-12);
            for at in [Vector2::zeros(), Vector2::new(300.0, -200.0), Vector2::new(-950.0, 530.0)] {
                assert!((lens.distorted(&lens.undistorted(&at)) - at).norm() < 1e-8, "{distortion} {at}");
            }
        }
    }

    #[test]
    fn derivatives_are_those_of_the_model() {
        let (lens, at) = (Lens::with_distortion(-0.2, SIZE), Vector2::new(610.0, -340.0));
        let step = Vector2::new(0.3, 0.4) * 1e-3;
        let moved = (lens.undistorted(&(at + step)) - lens.undistorted(&(at - step))) / 2.0;
        assert!((lens.undistorted_by_pixel(&at) * step - moved).norm() < 1e-9);
        let more = Lens { per_px2: lens.per_px2 + 1e-12 };
        let less = Lens { per_px2: lens.per_px2 - 1e-12 };
        let by_lens = (more.undistorted(&at) - less.undistorted(&at)) / 2e-12;
        let expected = lens.undistorted_by_lens(&at);
        assert!((by_lens - expected).norm() < 1e-6 * expected.norm());
    }

    #[test]
    fn opencv_numbers_describe_the_same_lens() {
        let lens = Lens::with_distortion(-0.02, SIZE);
        let [k1, k2] = lens.opencv(1500.0, SIZE);
        let back = Lens::from_opencv(k1, k2, 1500.0, SIZE);
        assert!((back.distortion(SIZE) + 0.02).abs() < 3e-4, "{}", back.distortion(SIZE));
        // A camera of the MEVA data set. Its published distortion is strong.
        let strong = Lens::from_opencv(-0.354, 0.122, 1453.0, ImageSize { width: 1920, height: 1072 });
        for x in [300.0, 700.0, 950.0] {
            let square = (x / 1453.0_f64).powi(2);
            let by_opencv = x * (1.0 - 0.354 * square + 0.122 * square * square);
            let ours = strong.distorted(&Vector2::new(x, 0.0)).x;
            assert!((ours - by_opencv).abs() < 4.0, "{x}: {ours} {by_opencv}");
        }
        assert_eq!(Lens::from_opencv(0.0, 0.0, 1500.0, SIZE), Lens::STRAIGHT);
    }
}
