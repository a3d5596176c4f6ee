//! Errors of focal length and ground plane (paper §Experiments, focal-length study: error relative to the truth).

use roadplane_base::GroundPlane;

/// Errors of one estimated camera; signed, estimate minus truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraError {
    /// (f − f*) / f*.
    pub focal_relative: f64,
    /// Optical axis below the horizontal, rad.
    pub tilt_rad: f64,
    /// Turn of the horizon, rad.
    pub roll_rad: f64,
    /// Angle between the normals, rad; not negative.
    pub normal_rad: f64,
    /// (h − h*) / h*.
    pub height_relative: f64,
}

/// Errors of an estimated focal length (px) and plane against the true ones.
#[must_use]
pub fn camera_error(
    focal_px: f64,
    plane: &GroundPlane,
    true_focal_px: f64,
    true_plane: &GroundPlane,
) -> CameraError {
    CameraError {
        focal_relative: focal_px / true_focal_px - 1.0,
        tilt_rad: plane.tilt() - true_plane.tilt(),
        roll_rad: roadplane_base::angle_difference(plane.roll(), true_plane.roll()),
        normal_rad: plane.normal_in_camera.angle(&true_plane.normal_in_camera),
        height_relative: plane.height_m / true_plane.height_m - 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_number_is_its_own() {
        let truth = GroundPlane::from_tilt_roll_height(0.30, 0.02, 8.0);
        let plane = GroundPlane::from_tilt_roll_height(0.33, 0.02, 8.8);
        let error = camera_error(1900.0, &plane, 2000.0, &truth);
        assert!((error.focal_relative + 0.05).abs() < 1e-12);
        assert!((error.tilt_rad - 0.03).abs() < 1e-12 && error.roll_rad.abs() < 1e-12);
        assert!((error.normal_rad - 0.03).abs() < 1e-9);
        assert!((error.height_relative - 0.1).abs() < 1e-12);
    }
}
