//! What a lens does to straight lines.

use nalgebra::{Matrix2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ImageSize;

/// Radial distortion by the division model (Fitzgibbon, CVPR 2001), in the picture's own units, so that it needs no focal length:
/// with p a pixel from the principal point, a lens that bends no lines would show it at `p / (1 + per_px2 · |p|²)`.
/// Barrel distortion is negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Lens {
    /// 1/px².
    pub per_px2: f64,
}

/// Radii at which two models are compared.
const STEPS: i32 = 50;
/// The division by less than this is not followed: no picture reaches so far.
const LEAST_DIVISOR: f64 = 0.1;

impl Lens {
    /// Straight lines stay straight.
    pub const STRAIGHT: Self = Self { per_px2: 0.0 };

    /// By its bend: what is added to 1 in the division at the middle of the picture's left and right side.
    #[must_use]
    pub fn with_bend(bend: f64, size: ImageSize) -> Self {
        Self { per_px2: bend / half_width_px(size).powi(2) }
    }

    /// That bend.
    #[must_use]
    pub fn bend(self, size: ImageSize) -> f64 {
        self.per_px2 * half_width_px(size).powi(2)
    }

    /// From OpenCV's k1 and k2 at a focal length, px: the bend that straightens the picture most alike, least squares along its
    /// half diagonal.
    #[must_use]
    pub fn from_opencv(k1: f64, k2: f64, focal_px: f64, size: ImageSize) -> Self {
        let reach = size.centre_px().norm() / focal_px;
        // Both models by what they do to a straight radius r: r_bent (1 + λ f² r_bent²)⁻¹ = r, linear in λ.
        let (mut sum, mut weight) = (0.0, 0.0);
        for step in 1..=STEPS {
            let straight = reach * f64::from(step) / f64::from(STEPS);
            let square = straight * straight;
            let bent = straight * (1.0 + k1 * square + k2 * square * square);
            // Beyond the radius at which the polynomial turns back it describes no lens.
            if 1.0 + 3.0 * k1 * square + 5.0 * k2 * square * square <= 0.0 {
                break;
            }
            let by_bend = straight * (focal_px * bent).powi(2);
            sum += by_bend * (bent - straight);
            weight += by_bend * by_bend;
        }
        Self { per_px2: if weight > 0.0 { sum / weight } else { 0.0 } }
    }

    /// OpenCV's k1 and k2 at a focal length, px, that bend the picture most alike, least squares along its half diagonal.
    #[must_use]
    pub fn opencv(self, focal_px: f64, size: ImageSize) -> [f64; 2] {
        let reach = size.centre_px().norm();
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for step in 1..=STEPS {
            let bent = Vector2::new(reach * f64::from(step) / f64::from(STEPS), 0.0);
            let straight = self.straightened(&bent).x / focal_px;
            let by = Vector2::new(straight.powi(3), straight.powi(5));
            normal += by * by.transpose();
            right += by * (bent.x / focal_px - straight);
        }
        normal.try_inverse().map_or([0.0; 2], |inverse| (inverse * right).into())
    }

    /// Where a straight lens would show a pixel; both from the principal point, px.
    #[must_use]
    pub fn straightened(self, bent: &Vector2<f64>) -> Vector2<f64> {
        bent / self.divisor(bent)
    }

    /// Where this lens shows what a straight one would show at a pixel; both from the principal point, px.
    #[must_use]
    pub fn bent(self, straight: &Vector2<f64>) -> Vector2<f64> {
        let root = (1.0 - 4.0 * self.per_px2 * straight.norm_squared()).max(0.0).sqrt();
        straight * (2.0 / (1.0 + root))
    }

    /// Derivative of [`Lens::straightened`] by the pixel.
    #[must_use]
    pub fn straightening(self, bent: &Vector2<f64>) -> Matrix2<f64> {
        let divisor = self.divisor(bent);
        (Matrix2::identity() - bent * bent.transpose() * (2.0 * self.per_px2 / divisor)) / divisor
    }

    /// Derivative of [`Lens::straightened`] by `per_px2`, px³.
    #[must_use]
    pub fn straightened_by_bend(self, bent: &Vector2<f64>) -> Vector2<f64> {
        -bent * (bent.norm_squared() / self.divisor(bent).powi(2))
    }

    fn divisor(self, bent: &Vector2<f64>) -> f64 {
        (1.0 + self.per_px2 * bent.norm_squared()).max(LEAST_DIVISOR)
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
    fn bending_undoes_straightening() {
        for bend in [-0.3, -0.05, 0.0, 0.05] {
            let lens = Lens::with_bend(bend, SIZE);
            assert!((lens.bend(SIZE) - bend).abs() < 1e-12);
            for at in [Vector2::zeros(), Vector2::new(300.0, -200.0), Vector2::new(-950.0, 530.0)] {
                assert!((lens.bent(&lens.straightened(&at)) - at).norm() < 1e-8, "{bend} {at}");
            }
        }
    }

    #[test]
    fn derivatives_are_those_of_the_model() {
        let (lens, at) = (Lens::with_bend(-0.2, SIZE), Vector2::new(610.0, -340.0));
        let step = Vector2::new(0.3, 0.4) * 1e-3;
        let moved = (lens.straightened(&(at + step)) - lens.straightened(&(at - step))) / 2.0;
        assert!((lens.straightening(&at) * step - moved).norm() < 1e-9);
        let more = Lens { per_px2: lens.per_px2 + 1e-12 };
        let less = Lens { per_px2: lens.per_px2 - 1e-12 };
        let by_bend = (more.straightened(&at) - less.straightened(&at)) / 2e-12;
        let told = lens.straightened_by_bend(&at);
        assert!((by_bend - told).norm() < 1e-6 * told.norm());
    }

    #[test]
    fn opencv_numbers_describe_the_same_lens() {
        let lens = Lens::with_bend(-0.02, SIZE);
        let [k1, k2] = lens.opencv(1500.0, SIZE);
        let back = Lens::from_opencv(k1, k2, 1500.0, SIZE);
        assert!((back.bend(SIZE) + 0.02).abs() < 3e-4, "{}", back.bend(SIZE));
        // A camera of MEVA, whose published numbers bend lines strongly.
        let strong = Lens::from_opencv(-0.354, 0.122, 1453.0, ImageSize { width: 1920, height: 1072 });
        for x in [300.0, 700.0, 950.0] {
            let square = (x / 1453.0_f64).powi(2);
            let by_opencv = x * (1.0 - 0.354 * square + 0.122 * square * square);
            let ours = strong.bent(&Vector2::new(x, 0.0)).x;
            assert!((ours - by_opencv).abs() < 4.0, "{x}: {ours} {by_opencv}");
        }
        assert_eq!(Lens::from_opencv(0.0, 0.0, 1500.0, SIZE), Lens::STRAIGHT);
    }
}
