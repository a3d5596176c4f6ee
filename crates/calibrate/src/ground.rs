//! Points on the ground.

use nalgebra::{Vector2, Vector3};
use roadplane_base::{Camera, CameraParams};

/// Returns the point at which the viewing ray of a pixel meets the ground, in the camera frame, m.
///
/// The pixel is undistorted and relative to the principal point. Returns `None` if it lies at or above the horizon.
pub(crate) fn ground(params: &CameraParams, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
    let plane = params.plane();
    let camera = Camera::pinhole(params.focal_px(), Vector2::zeros());
    let ray = camera.ray_from_pixel(pixel);
    let falling = -plane.normal_in_camera.dot(&ray);
    (falling > 1e-6).then(|| ray * (plane.height_m / falling))
}
