//! Rotation errors for the viewpoint precision of Xiang et al. 2014, "Beyond PASCAL".
//!
//! There is no condition on the overlap of boxes, as in Table 2 of Li et al., *Car Pose in Context*.

use nalgebra::UnitQuaternion;

/// Thresholds of the rotation error in Table 2 of Li et al., *Car Pose in Context*, rad.
pub const THRESHOLDS_RAD: [f64; 5] = [0.14, 0.21, 0.28, 0.35, 0.42];

/// Returns the geodesic distance of two rotations: the angle of the rotation between them, rad in 0–π.
///
/// For rotation matrices R₁ and R₂ the distance is `‖log(R₁ᵀ R₂)‖ / √2`.
#[must_use]
pub fn rotation_error_rad(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
    a.angle_to(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn the_error_is_the_angle_of_the_turn_between() {
        let a = UnitQuaternion::from_euler_angles(0.3, -1.0, 2.0);
        let turn = UnitQuaternion::from_axis_angle(
            &nalgebra::Unit::new_unchecked(Vector3::new(0.6, 0.0, 0.8)),
            0.25,
        );
        assert!((rotation_error_rad(&a, &(a * turn)) - 0.25).abs() < 1e-7);
        assert!((rotation_error_rad(&(turn * a), &a) - 0.25).abs() < 1e-7);
        // A quaternion and its negative are one rotation.
        let negative = UnitQuaternion::new_unchecked(-a.into_inner());
        assert!(rotation_error_rad(&a, &negative) < 1e-7);
        let back = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        assert!((rotation_error_rad(&a, &(a * back)) - std::f64::consts::PI).abs() < 1e-7);
    }
}
