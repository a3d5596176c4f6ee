//! Poses of cars on the ground plane, and arithmetic of angles.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Pose of a car on the ground plane: position and heading in the world frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundPose {
    /// World x of the car's origin, m.
    pub x_m: f64,
    /// World y of the car's origin, m.
    pub y_m: f64,
    /// Direction of the car's x axis (forward), rad. It is 0 along world +x and grows counter-clockwise, as seen from
    /// above.
    pub heading_rad: f64,
}

impl GroundPose {
    /// Returns the rigid motion from car to world coordinates.
    #[must_use]
    pub fn world_from_car(&self) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(self.x_m, self.y_m, 0.0),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.heading_rad),
        )
    }

    /// Projects a pose with six degrees of freedom onto the ground.
    ///
    /// The projected origin gives the position. The projected forward axis gives the heading.
    #[must_use]
    pub fn nearest(world_from_car: &Isometry3<f64>) -> Self {
        let forward = world_from_car.rotation * Vector3::x();
        let origin = world_from_car.translation.vector;
        Self { x_m: origin.x, y_m: origin.y, heading_rad: forward.y.atan2(forward.x) }
    }
}

/// Returns an angle modulo 2π, rad, in (−π, π].
#[must_use]
pub fn wrap_angle(angle_rad: f64) -> f64 {
    let turned = angle_rad.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

/// Returns an angle modulo π, rad, in (−π/2, π/2].
///
/// Opposite directions give the same result, so the result describes a line and not a direction along it.
#[must_use]
pub fn fold_axis(angle_rad: f64) -> f64 {
    let folded = angle_rad.rem_euclid(PI);
    if folded > PI / 2.0 { folded - PI } else { folded }
}

/// Returns the shortest rotation from angle `b` to angle `a`, rad, in (−π, π].
#[must_use]
pub fn angle_difference(a: f64, b: f64) -> f64 {
    wrap_angle(a - b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ground_pose_survives(x in -50.0f64..50.0, y in 0.0f64..90.0, heading in -3.1f64..3.1) {
            let pose = GroundPose { x_m: x, y_m: y, heading_rad: heading };
            let back = GroundPose::nearest(&pose.world_from_car());
            prop_assert!((back.x_m - x).abs() < 1e-12 && (back.y_m - y).abs() < 1e-12);
            prop_assert!(angle_difference(back.heading_rad, heading).abs() < 1e-12);
        }

        #[test]
        fn wrapped_angles_differ_by_whole_turns(angle in -100.0f64..100.0) {
            let wrapped = wrap_angle(angle);
            prop_assert!(wrapped > -PI - 1e-12 && wrapped <= PI + 1e-12);
            prop_assert!(((angle - wrapped) / TAU).fract().abs() < 1e-9
                || (1.0 - ((angle - wrapped) / TAU).fract().abs()) < 1e-9);
        }
    }
}
