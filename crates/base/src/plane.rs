//! The ground plane in the camera frame, and the world frame that it defines.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

use crate::Camera;

/// A ground plane in the camera frame. Its points X satisfy `normal_in_camera · X + height_m = 0`.
///
/// The unit normal points up, so the camera's centre is `height_m` above the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// Unit normal of the plane, in the camera frame. It points up.
    pub normal_in_camera: Vector3<f64>,
    /// Height of the camera's centre above the plane, m. It is positive.
    pub height_m: f64,
}

impl GroundPlane {
    /// Creates a plane from its tilt, roll and height. The normal is
    /// `(sin roll cos tilt, −cos roll cos tilt, −sin tilt)`.
    ///
    /// `tilt` is the angle of the optical axis below the horizontal, rad. `roll` is the clockwise turn of the horizon
    /// in the image, rad. `height_m` is the camera's height above the plane, m.
    #[must_use]
    pub fn from_tilt_roll_height(tilt: f64, roll: f64, height_m: f64) -> Self {
        let (sin_t, cos_t) = tilt.sin_cos();
        let (sin_r, cos_r) = roll.sin_cos();
        Self { normal_in_camera: Vector3::new(sin_r * cos_t, -cos_r * cos_t, -sin_t), height_m }
    }

    /// Returns the angle of the optical axis below the horizontal, rad.
    #[must_use]
    pub fn tilt(&self) -> f64 {
        (-self.normal_in_camera.z).clamp(-1.0, 1.0).asin()
    }

    /// Returns the clockwise turn of the horizon in the image, rad.
    #[must_use]
    pub fn roll(&self) -> f64 {
        self.normal_in_camera.x.atan2(-self.normal_in_camera.y)
    }

    /// Returns the height of a point above the plane, m. The point is in the camera frame.
    ///
    /// The height is `D_p2p` in Eq. 4 of Li et al., *Car Pose in Context*.
    #[must_use]
    pub fn height_of(&self, point_in_camera: &Vector3<f64>) -> f64 {
        self.normal_in_camera.dot(point_in_camera) + self.height_m
    }

    /// Returns one over the factor by which a ray from the camera must be multiplied to meet the plane; negative for rays
    /// above the horizon.
    #[must_use]
    pub fn inverse_distance(&self, ray: &Vector3<f64>) -> f64 {
        -self.normal_in_camera.dot(ray) / self.height_m
    }

    /// Returns the rigid motion from world to camera coordinates.
    ///
    /// If the camera points straight down, the image's up direction defines the world's y axis.
    #[must_use]
    pub fn camera_from_world(&self) -> Isometry3<f64> {
        let up = self.normal_in_camera;
        let laid = |v: Vector3<f64>| (v - up * up.dot(&v)).try_normalize(1e-9);
        let forward = laid(Vector3::z()).or_else(|| laid(-Vector3::y())).unwrap_or_else(Vector3::z);
        let right = forward.cross(&up);
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, forward, up]));
        Isometry3::from_parts(
            Translation3::from(-self.height_m * up),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }

    /// Returns the point at which the viewing ray of a pixel meets the plane: world x and y, m.
    ///
    /// Returns `None` if the pixel lies at or above the horizon.
    #[must_use]
    pub fn world_from_pixel(&self, camera: &Camera, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let ray = camera.ray_from_pixel(pixel);
        let falling = -self.normal_in_camera.dot(&ray);
        (falling > 1e-9).then(|| {
            let point_in_camera = ray * (self.height_m / falling);
            (self.camera_from_world().inverse() * nalgebra::Point3::from(point_in_camera)).coords.xy()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn tilt_roll_height_survive(tilt in -0.2f64..1.5, roll in -0.5f64..0.5, height in 1.0f64..40.0) {
            let plane = GroundPlane::from_tilt_roll_height(tilt, roll, height);
            prop_assert!((plane.tilt() - tilt).abs() < 1e-9);
            prop_assert!((plane.roll() - roll).abs() < 1e-9);
            prop_assert!((plane.normal_in_camera.norm() - 1.0).abs() < 1e-12);
        }

        #[test]
        fn world_is_as_documented(tilt in 0.0f64..1.5, roll in -0.5f64..0.5, height in 1.0f64..40.0) {
            let plane = GroundPlane::from_tilt_roll_height(tilt, roll, height);
            let world_from_camera = plane.camera_from_world().inverse();
            let centre = world_from_camera.translation.vector;
            prop_assert!((centre - Vector3::new(0.0, 0.0, height)).norm() < 1e-9);
            let axis = world_from_camera.rotation * Vector3::z();
            prop_assert!(axis.x.abs() < 1e-9 && axis.y > 0.0 && (axis.z + tilt.sin()).abs() < 1e-9);
            let right = world_from_camera.rotation * Vector3::x();
            prop_assert!(right.x > 0.0);
        }

        #[test]
        fn pixel_to_ground_and_back(tilt in 0.1f64..1.4, roll in -0.3f64..0.3, x in -20.0f64..20.0, y in 5.0f64..60.0) {
            let plane = GroundPlane::from_tilt_roll_height(tilt, roll, 8.0);
            let camera = Camera::pinhole(1500.0, Vector2::new(639.5, 359.5));
            let in_camera = plane.camera_from_world() * nalgebra::Point3::new(x, y, 0.0);
            prop_assume!(in_camera.z > 0.5);
            let pixel = camera.pixel_from_camera(&in_camera.coords);
            prop_assert!(pixel.is_some());
            let back = pixel.and_then(|p| plane.world_from_pixel(&camera, &p));
            prop_assert!(back.is_some_and(|b| (b - Vector2::new(x, y)).norm() < 1e-6));
        }
    }

    #[test]
    fn a_positive_roll_turns_the_horizon_clockwise() {
        // Far points to the right must lie lower in the image (larger y) than far points to the left.
        let plane = GroundPlane::from_tilt_roll_height(0.3, 0.1, 8.0);
        let camera = Camera::pinhole(1000.0, Vector2::zeros());
        let row = |x: f64| {
            let p = plane.camera_from_world() * nalgebra::Point3::new(x, 1e6, 0.0);
            camera.pixel_from_camera(&p.coords).map(|p| p.y)
        };
        assert!(row(3e5) > row(-3e5));
    }
}
