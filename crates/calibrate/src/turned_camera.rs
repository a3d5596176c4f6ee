//! The camera of another picture of the same place: it is turned and zoomed by a known homography.
//!
//! A camera that turns by R and zooms by g maps its pixels by `K₁ R K₀⁻¹`. Here `K₁` has the focal length g f. Its
//! centre stays where it is, so the normal of the ground is turned by R and the height is the same.

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{CameraParams, GroundPlane, Homography, JointInformation};

use crate::factors::derivatives_by_camera;

/// Returns the camera after a turn and a zoom. `homography` maps undistorted pixels of its picture to those of the
/// turned camera, and `centre_px` is the principal point of both. `None` if the homography is no turn.
fn turned_camera(
    camera: &CameraParams,
    homography: &Homography,
    centre_px: &Vector2<f64>,
) -> Option<CameraParams> {
    let focal_px = camera.focal_px();
    let turn = homography.turn(focal_px, centre_px)?;
    let plane = camera.plane();
    let turned = GroundPlane { normal_in_camera: turn.rotation * plane.normal_in_camera, ..plane };
    Some(CameraParams::new(focal_px * turn.growth, &turned))
}

/// Returns the camera after a turn and a zoom, and the information on it. `homography` maps undistorted pixels of its
/// picture to those of the turned camera, and `centre_px` is the principal point of both. Both before and
/// after the turn, the mean of the information is the camera itself. `None` if the homography is no turn.
#[must_use]
pub fn turned_information(
    camera: &CameraParams,
    joint: &JointInformation,
    homography: &Homography,
    centre_px: &Vector2<f64>,
) -> Option<(CameraParams, JointInformation)> {
    let turned = turned_camera(camera, homography, centre_px)?;
    let turned_numbers = |numbers: &Vector4<f64>| {
        Some(turned_camera(&CameraParams::from_vector(numbers), homography, centre_px)?.to_vector())
    };
    let derivative = derivatives_by_camera(turned_numbers, &camera.to_vector())?;
    let inverse = Matrix4::from_columns(&derivative).try_inverse()?;
    let information = inverse.transpose() * joint.information * inverse;
    let information = (information + information.transpose()) / 2.0;
    let cross = inverse.transpose() * joint.cross;
    Some((
        turned,
        JointInformation { cross, ..JointInformation::of_camera(&information, &turned.to_vector()) },
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Matrix4x5, Rotation3, Vector3};
    use proptest::prelude::*;
    use roadplane_base::Camera;

    const CENTRE_PX: Vector2<f64> = Vector2::new(959.5, 539.5);

    fn intrinsics(focal_px: f64) -> Matrix3<f64> {
        Matrix3::new(focal_px, 0.0, CENTRE_PX.x, 0.0, focal_px, CENTRE_PX.y, 0.0, 0.0, 1.0)
    }

    proptest! {
        #[test]
        fn a_turned_camera_sees_the_same_ground(
            turn in [-0.2_f64..0.2, -0.2_f64..0.2, -0.1_f64..0.1],
            growth in 0.7_f64..1.5,
            tilt in 0.3_f64..0.9,
        ) {
            let camera = CameraParams { log_focal: 7.2, tilt, roll: 0.04, log_height: 2.1 };
            let rotation = Rotation3::from_euler_angles(turn[0], turn[1], turn[2]);
            let focal_px = camera.focal_px();
            let matrix = intrinsics(growth * focal_px) * rotation.matrix() * intrinsics(focal_px).try_inverse().unwrap();
            let homography = Homography::new(matrix).unwrap();
            let turned = turned_camera(&camera, &homography, &CENTRE_PX).unwrap();
            // Distances between points of the ground are the same in both pictures.
            let place = |params: &CameraParams, pixel: &Vector2<f64>| {
                params.plane().world_from_pixel(&Camera::pinhole(params.focal_px(), CENTRE_PX), pixel)
            };
            let pixels = [Vector2::new(900.0, 900.0), Vector2::new(1100.0, 1000.0)];
            let distance = |params: &CameraParams, pixels: [Vector2<f64>; 2]| {
                Some((place(params, &pixels[0])? - place(params, &pixels[1])?).norm())
            };
            let before = distance(&camera, pixels).unwrap();
            if let Some(after) = distance(&turned, pixels.map(|pixel| homography.apply(&pixel))) {
                prop_assert!((after / before - 1.0).abs() < 1e-6, "{before} {after}");
            }
            let back = turned_camera(&turned, &homography.inverse(), &CENTRE_PX).unwrap();
            prop_assert!((back.to_vector() - camera.to_vector()).amax() < 1e-6);
        }
    }

    #[test]
    fn information_is_the_same_after_a_turn_and_back() {
        let camera = CameraParams { log_focal: 7.2, tilt: 0.4, roll: 0.02, log_height: 2.1 };
        let root =
            Matrix4::new(9.0, 1.0, 0.5, 3.0, 0.0, 30.0, 2.0, 1.0, 0.0, 0.0, 50.0, 0.0, 0.0, 0.0, 0.0, 6.0);
        let joint = JointInformation {
            cross: Matrix4x5::from_fn(|r, c| (r + 2 * c) as f64),
            ..JointInformation::of_camera(&(root.transpose() * root), &camera.to_vector())
        };
        let rotation = Rotation3::from_scaled_axis(Vector3::new(0.05, 0.1, 0.01));
        let focal_px = camera.focal_px();
        let matrix = intrinsics(focal_px) * rotation.matrix() * intrinsics(focal_px).try_inverse().unwrap();
        let homography = Homography::new(matrix).unwrap();
        let (turned, there) = turned_information(&camera, &joint, &homography, &CENTRE_PX).unwrap();
        assert!((turned.tilt - camera.tilt).abs() > 0.04, "{turned:?}");
        let (_, back) = turned_information(&turned, &there, &homography.inverse(), &CENTRE_PX).unwrap();
        // With another focal length, the homography is not quite a turn, so the way back is not quite the inverse.
        let near = |a: f64, b: f64| (a - b).abs() < 0.1 * (1.0 + b.abs());
        assert!(back.information.iter().zip(&joint.information).all(|(a, b)| near(*a, *b)), "{back:?}");
        assert!(back.cross.iter().zip(&joint.cross).all(|(a, b)| near(*a, *b)));
    }
}
