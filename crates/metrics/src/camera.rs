//! Errors of the focal length and the ground plane.
//!
//! The error of the focal length is relative to the truth, as in the focal-length study of Li et al., *Car Pose in
//! Context* (§Experiments).

use nalgebra::Matrix4;
use roadplane_base::GroundPlane;

/// Errors of one estimated camera. Errors are signed: estimate minus truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraError {
    /// Error of the focal length f, relative to the truth f*: (f − f*) / f*.
    pub focal_relative: f64,
    /// Error of the tilt, rad. The tilt is the angle of the optical axis below the horizontal.
    pub tilt_rad: f64,
    /// Error of the roll, rad. The roll is the rotation of the horizon in the picture.
    pub roll_rad: f64,
    /// Angle between the estimated and the true plane normal, rad. The angle is never negative.
    pub normal_rad: f64,
    /// Error of the height h, relative to the truth h*: (h − h*) / h*.
    pub height_relative: f64,
    /// Errors of the log focal length, tilt and log height. Each is divided by the standard deviation that the
    /// estimator reports, or is NaN if the estimator reports none.
    pub in_sds: [f64; 3],
}

impl CameraError {
    /// Returns a copy of the errors in which `in_sds` is computed. `covariance` is the covariance that the estimator
    /// reports for (log focal length, tilt, roll, log height).
    #[must_use]
    pub fn against_claimed(self, covariance: &Matrix4<f64>) -> Self {
        let in_sds = |error: f64, number: usize| {
            let sd = covariance[(number, number)].sqrt();
            if sd > 0.0 && sd.is_finite() { error / sd } else { f64::NAN }
        };
        let [focal, height] = [self.focal_relative, self.height_relative].map(f64::ln_1p);
        Self { in_sds: [in_sds(focal, 0), in_sds(self.tilt_rad, 1), in_sds(height, 3)], ..self }
    }
}

/// Returns the errors of an estimated focal length (px) and ground plane against the true ones. `in_sds` of the result
/// is NaN.
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
        in_sds: [f64::NAN; 3],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_error_has_its_own_field() {
        let truth = GroundPlane::from_tilt_roll_height(0.30, 0.02, 8.0);
        let plane = GroundPlane::from_tilt_roll_height(0.33, 0.02, 8.8);
        let error = camera_error(1900.0, &plane, 2000.0, &truth);
        assert!((error.focal_relative + 0.05).abs() < 1e-12);
        assert!((error.tilt_rad - 0.03).abs() < 1e-12 && error.roll_rad.abs() < 1e-12);
        assert!((error.normal_rad - 0.03).abs() < 1e-9);
        assert!((error.height_relative - 0.1).abs() < 1e-12);
        assert!(error.in_sds.iter().all(|error| error.is_nan()));
        let claimed = Matrix4::from_diagonal(&nalgebra::Vector4::new(0.0, 1e-4, f64::INFINITY, 0.04));
        let [focal, tilt, height] = error.against_claimed(&claimed).in_sds;
        assert!(focal.is_nan() && (tilt - 3.0).abs() < 1e-9 && (height - 1.1f64.ln() / 0.2).abs() < 1e-9);
    }
}
