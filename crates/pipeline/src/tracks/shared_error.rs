//! Propagates errors of the camera to positions on the ground. All cars of a clip share these errors.
//!
//! A car is observed at a pixel, and the camera maps that pixel to the ground. The map is linearised in the camera's
//! four numbers (log focal length, tilt, roll, log height) by central differences. The log height contains the error of
//! the scale.

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{Camera, CameraEstimate, CameraParams, GroundPart, GroundPose};
use roadplane_calibrate::derivatives_by_camera;

/// Returns the derivatives of x, y (m), heading (rad) and log speed at a position by the camera's numbers (columns).
///
/// `None` where the position is not visible.
#[must_use]
pub fn by_camera(estimate: &CameraEstimate, pose: &GroundPose) -> Option<Matrix4<f64>> {
    let part = estimate.ground().part_at(pose.x_m, pose.y_m);
    by_camera_above(&part, &estimate.above(&part), pose)
}

/// As [`by_camera`], for the camera above the plane at the position.
fn by_camera_above(part: &GroundPart, camera: &CameraEstimate, pose: &GroundPose) -> Option<Matrix4<f64>> {
    let pose = part.from_surface(pose);
    // The direction is that of a path of one metre.
    let ahead = Vector2::new(pose.heading_rad.cos(), pose.heading_rad.sin());
    let from = Vector2::new(pose.x_m, pose.y_m);
    let pixels = [pixel_of(camera, &from)?, pixel_of(camera, &(from + ahead))?];
    let laid = |numbers: &Vector4<f64>| -> Option<Vector4<f64>> {
        let params = CameraParams::from_vector(numbers);
        let (plane, camera) = (params.plane(), Camera { focal_px: params.focal_px(), ..camera.camera() });
        let at = plane.world_from_pixel(&camera, &pixels[0])?;
        let moved = plane.world_from_pixel(&camera, &pixels[1])? - at;
        // The turn is relative to the original direction, so that no angle wraps.
        let turn = (ahead.x * moved.y - ahead.y * moved.x).atan2(ahead.dot(&moved));
        Some(Vector4::new(at.x, at.y, turn, moved.norm().ln()))
    };
    let mut by = Matrix4::from_columns(&derivatives_by_camera(laid, &camera.params.to_vector())?);
    let on_surface = part.surface_from_plane.rotation.to_rotation_matrix() * by.fixed_rows::<2>(0);
    by.fixed_rows_mut::<2>(0).copy_from(&on_surface);
    Some(by)
}

/// Returns the covariance of x, y, heading and log speed from the camera's errors; zero where these are not finite.
#[must_use]
pub fn shared_covariance(estimate: &CameraEstimate, pose: &GroundPose) -> Matrix4<f64> {
    let part = estimate.ground().part_at(pose.x_m, pose.y_m);
    let camera = estimate.above(&part);
    if !camera.covariance.iter().all(|v| v.is_finite()) {
        return Matrix4::zeros();
    }
    let by = by_camera_above(&part, &camera, pose);
    by.map_or_else(Matrix4::zeros, |by| by * camera.covariance * by.transpose())
}

/// Returns the pixel of a ground position; `None` where it is not in front of the camera.
fn pixel_of(estimate: &CameraEstimate, at: &Vector2<f64>) -> Option<Vector2<f64>> {
    let camera = estimate.camera();
    let plane = estimate.params.plane();
    let point = plane.camera_from_world() * nalgebra::Point3::new(at.x, at.y, 0.0);
    camera.pixel_from_camera(&point.coords)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use roadplane_base::{CameraStatus, ImageSize, Lens};

    /// Returns a camera estimate with these sds.
    pub(crate) fn estimate(sd: [f64; 4]) -> CameraEstimate {
        let size = ImageSize { width: 1280, height: 720 };
        CameraEstimate {
            span_s: [0.0, 9.0],
            image_size_px: size,
            principal_point_px: size.centre_px(),
            lens: Lens::STRAIGHT,
            distortion_sd: None,
            params: CameraParams { log_focal: 7.0, tilt: 0.3, roll: 0.02, log_height: 2.2 },
            covariance: Matrix4::from_diagonal(&Vector4::from(sd).map(|v| v * v)),
            status: CameraStatus::Estimated,
            cars_used: 9,
            frames_used: 9,
            second_plane: None,
        }
    }

    #[test]
    fn an_unknown_height_scales_the_world() {
        let estimate = estimate([1e-9, 1e-9, 1e-9, 0.05]);
        let pose = GroundPose { x_m: 6.0, y_m: 40.0, heading_rad: 1.1 };
        let covariance = shared_covariance(&estimate, &pose);
        let sd = |i: usize| covariance[(i, i)].sqrt();
        // Positions and speeds grow with the height; directions do not change.
        assert!((sd(0) - 0.05 * 6.0).abs() < 1e-4 && (sd(1) - 0.05 * 40.0).abs() < 1e-4);
        assert!(sd(2) < 1e-6 && (sd(3) - 0.05).abs() < 1e-6);
    }

    /// The script `scripts/python/geometry_fixture.py` made the file. The Python package is tested against it, too.
    #[test]
    fn the_geometry_is_that_of_the_python_package() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/geometry.json");
        let fixture: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let cases = fixture["cases"].as_array().unwrap();
        assert_eq!(cases.len(), 4);
        for case in cases {
            let read = |key: &str| case[key].clone();
            let two = |key: &str| serde_json::from_value::<Vec<Vector2<f64>>>(read(key)).unwrap();
            let params = serde_json::from_value::<Vector4<f64>>(read("params")).unwrap();
            let rows = serde_json::from_value::<[[f64; 4]; 4]>(read("covariance")).unwrap();
            let estimate = CameraEstimate {
                params: CameraParams::from_vector(&params),
                covariance: Matrix4::from_fn(|r, c| rows[r][c]),
                lens: Lens::with_distortion(case["bend"].as_f64().unwrap(), estimate([0.0; 4]).image_size_px),
                ..estimate([0.0; 4])
            };
            let (camera, plane) = (estimate.camera(), estimate.params.plane());
            let (ground, sds) = (two("ground_m"), two("ground_sd_m"));
            assert!(ground.len() >= 3);
            for (i, pixel) in two("pixels").iter().enumerate() {
                let at = plane.world_from_pixel(&camera, pixel).unwrap();
                assert!((at - ground[i]).norm() < 1e-9 * at.norm(), "{at} {}", ground[i]);
                let pose = GroundPose { x_m: at.x, y_m: at.y, heading_rad: 0.3 };
                let covariance = shared_covariance(&estimate, &pose);
                let sd = Vector2::new(covariance[(0, 0)].sqrt(), covariance[(1, 1)].sqrt());
                assert!((sd - sds[i]).norm() < 1e-6 * sd.norm(), "{sd} {}", sds[i]);
            }
            let points = serde_json::from_value::<Vec<nalgebra::Point3<f64>>>(read("points_m")).unwrap();
            for (point, pixel) in points.iter().zip(two("points_px")) {
                let found = camera.pixel_from_camera(&(plane.camera_from_world() * point).coords).unwrap();
                assert!((found - pixel).norm() < 1e-7, "{found} {pixel}");
            }
        }
    }

    #[test]
    fn a_roll_moves_what_is_aside_and_far() {
        let estimate = estimate([1e-9, 1e-9, 0.01, 1e-9]);
        let sd = |x_m: f64, y_m: f64| {
            shared_covariance(&estimate, &GroundPose { x_m, y_m, heading_rad: 0.0 })[(1, 1)].sqrt()
        };
        assert!(sd(15.0, 40.0) > 2.0 * sd(2.0, 40.0) && sd(15.0, 60.0) > sd(15.0, 30.0));
    }
}
