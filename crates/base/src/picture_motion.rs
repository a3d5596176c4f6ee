//! Motion of a picture that a lens distorts: the distortion is removed, the picture is mapped by a homography, and the
//! distortion is applied again.

use nalgebra::{Matrix2, Vector2};

use crate::{Homography, ImageSize, KeypointSet, Lens, bbox_mapped};

/// Mapping between the pixels of two pictures that one lens shows.
///
/// Let U remove the lens distortion of a pixel. A camera that turns or zooms maps a pixel p to `U⁻¹(H U(p))`, where H is
/// the homography `K₁ R K₀⁻¹`. The lens is the same for both pictures, so the mappings of one lens form a group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureMotion {
    /// Homography between undistorted pixels, px.
    pub homography: Homography,
    /// Lens of both pictures.
    pub lens: Lens,
    /// Centre of the distortion, px.
    pub centre_px: Vector2<f64>,
}

impl From<Homography> for PictureMotion {
    fn from(homography: Homography) -> Self {
        Self { homography, lens: Lens::STRAIGHT, centre_px: Vector2::zeros() }
    }
}

impl PictureMotion {
    /// The mapping that leaves each pixel where it is.
    pub const IDENTITY: Self =
        Self { homography: Homography::IDENTITY, lens: Lens::STRAIGHT, centre_px: Vector2::new(0.0, 0.0) };

    /// Creates a mapping for pictures of a size. The middle of the picture is the centre of the distortion.
    #[must_use]
    pub fn new(homography: Homography, lens: Lens, size: ImageSize) -> Self {
        Self { homography, lens, centre_px: size.centre_px() }
    }

    /// Whether the mapping leaves each pixel where it is.
    #[must_use]
    pub fn is_identity(&self) -> bool {
        self.homography == Homography::IDENTITY
    }

    fn is_straight(&self) -> bool {
        self.lens == Lens::STRAIGHT
    }

    /// Returns the mapped pixel. A pixel that is mapped to infinity goes very far.
    #[must_use]
    pub fn apply(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        if self.is_straight() {
            return self.homography.apply(pixel);
        }
        let straight = self.lens.undistorted(&(pixel - self.centre_px)) + self.centre_px;
        self.lens.distorted(&(self.homography.apply(&straight) - self.centre_px)) + self.centre_px
    }

    /// Returns the derivative of the mapped pixel by the pixel.
    #[must_use]
    pub fn jacobian(&self, pixel: &Vector2<f64>) -> Matrix2<f64> {
        if self.is_straight() {
            return self.homography.jacobian(pixel);
        }
        let from = pixel - self.centre_px;
        let straight = self.lens.undistorted(&from) + self.centre_px;
        let to = self.lens.distorted(&(self.homography.apply(&straight) - self.centre_px));
        let back = self.lens.undistorted_by_pixel(&to).try_inverse().unwrap_or_else(Matrix2::identity);
        back * self.homography.jacobian(&straight) * self.lens.undistorted_by_pixel(&from)
    }

    /// Returns the inverse mapping.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self { homography: self.homography.inverse(), ..*self }
    }

    /// Returns the mapping that applies `self` first and `next` afterwards. `next` has the same lens.
    #[must_use]
    pub fn then(&self, next: &Homography) -> Self {
        Self { homography: self.homography.then(next), ..*self }
    }

    /// Returns the mapping between two others of one lens, at a share of the way; see [`Homography::between`].
    #[must_use]
    pub fn between(&self, other: &Self, share: f64) -> Self {
        Self { homography: self.homography.between(&other.homography, share), ..*self }
    }

    /// Returns the same mapping in pixels of a resized picture: `to = scale · from`. The origin is the centre of the
    /// distortion.
    #[must_use]
    pub fn in_scale(&self, scale: f64) -> Self {
        Self {
            homography: self.homography.in_coordinates(scale, Vector2::zeros()),
            lens: Lens { per_px2: self.lens.per_px2 / (scale * scale) },
            ..*self
        }
    }

    /// Returns the mapping of a box: the middles of its edges are mapped. A rotation does not enlarge the box.
    #[must_use]
    pub fn apply_to_box(&self, bbox_px: &[f64; 4]) -> [f64; 4] {
        bbox_mapped(bbox_px, |pixel| self.apply(pixel))
    }

    /// Maps the keypoints of a car and their covariances.
    pub fn apply_to_keypoints(&self, keypoints: &mut KeypointSet) {
        for point in keypoints.iter_mut().flatten() {
            let jacobian = self.jacobian(&point.pixel);
            point.pixel = self.apply(&point.pixel);
            point.covariance_px2 = jacobian * point.covariance_px2 * jacobian.transpose();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3};
    use proptest::prelude::*;

    const SIZE: ImageSize = ImageSize { width: 1280, height: 720 };

    fn turned(pan: f64, bend: f64) -> PictureMotion {
        let k = Matrix3::new(1200.0, 0.0, 639.5, 0.0, 1200.0, 359.5, 0.0, 0.0, 1.0);
        let rotation = Rotation3::from_euler_angles(0.03, pan, 0.02);
        let homography = Homography::new(k * rotation.matrix() * k.try_inverse().unwrap()).unwrap();
        PictureMotion::new(homography, Lens::with_distortion(bend, SIZE), SIZE)
    }

    proptest! {
        #[test]
        fn inverse_and_derivative_agree_with_the_mapping(
            pan in -0.15f64..0.15, bend in -0.15f64..0.03, x in 200.0f64..1000.0, y in 100.0f64..600.0,
        ) {
            let motion = turned(pan, bend);
            let p = Vector2::new(x, y);
            prop_assert!((motion.inverse().apply(&motion.apply(&p)) - p).norm() < 1e-6);
            for axis in [Vector2::x(), Vector2::y()] {
                let step = 1e-4;
                let numeric = (motion.apply(&(p + step * axis)) - motion.apply(&(p - step * axis))) / (2.0 * step);
                prop_assert!((numeric - motion.jacobian(&p) * axis).norm() < 1e-5);
            }
        }

        #[test]
        fn two_turns_make_one(a in -0.1f64..0.1, b in -0.1f64..0.1) {
            let (first, second) = (turned(a, -0.1), turned(b, -0.1));
            let p = Vector2::new(500.0, 300.0);
            let both = first.then(&second.homography).apply(&p);
            prop_assert!((both - second.apply(&first.apply(&p))).norm() < 1e-6);
        }
    }

    #[test]
    fn without_distortion_it_is_the_homography() {
        let motion = turned(0.1, 0.0);
        let p = Vector2::new(100.0, 650.0);
        assert_eq!(motion.apply(&p), motion.homography.apply(&p));
        assert_eq!(
            motion.apply_to_box(&[1.0, 2.0, 30.0, 40.0]),
            bbox_mapped(&[1.0, 2.0, 30.0, 40.0], |pixel| motion.homography.apply(pixel))
        );
        let shown = PictureMotion::from(motion.homography).jacobian(&p);
        assert_eq!(shown, motion.homography.jacobian(&p));
    }
}
