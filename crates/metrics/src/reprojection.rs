//! Reprojection error: the distance in the picture between estimated and true keypoints.

use nalgebra::{Isometry3, Point3, Vector2};
use roadplane_base::Camera;

/// Returns the root mean square distance (px) between an estimate's projected keypoints and the true pixels.
///
/// `points_in_car` and `true_pixels` have one entry per keypoint. The estimated camera and pose project the points,
/// which are in the car frame (m). Returns `None` if no keypoint is present on both sides, or if a point lies behind
/// the camera.
#[must_use]
pub fn reprojection_rms_px(
    camera: &Camera,
    camera_from_car: &Isometry3<f64>,
    points_in_car: &[Option<Point3<f64>>],
    true_pixels: &[Option<Vector2<f64>>],
) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0usize);
    for (point, pixel) in points_in_car.iter().zip(true_pixels) {
        if let (Some(point), Some(pixel)) = (point, pixel) {
            sum += (camera.pixel_from_camera(&(camera_from_car * point).coords)? - pixel).norm_squared();
            count += 1;
        }
    }
    (count > 0).then(|| (sum / count as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    #[test]
    fn a_shift_of_one_of_two_points() {
        let camera = Camera::pinhole(1000.0, Vector2::new(500.0, 300.0));
        let pose = Isometry3::from_parts(Translation3::new(0.0, 0.0, 10.0), UnitQuaternion::identity());
        let points = [Some(Point3::origin()), Some(Point3::new(1.0, 0.0, 0.0)), None];
        // The second point is projected to (600, 300), 5 px from its true pixel.
        let pixels = [Some(Vector2::new(500.0, 300.0)), Some(Vector2::new(603.0, 304.0)), None];
        let rms = reprojection_rms_px(&camera, &pose, &points, &pixels).unwrap();
        assert!((rms - 12.5f64.sqrt()).abs() < 1e-9);
        let behind = Isometry3::translation(0.0, 0.0, -10.0);
        assert_eq!(reprojection_rms_px(&camera, &behind, &points, &pixels), None);
    }
}
