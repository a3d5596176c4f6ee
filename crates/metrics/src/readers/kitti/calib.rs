//! Reads the projection of camera 2 from KITTI's `calib/*.txt`.

use std::path::Path;

use nalgebra::{Vector2, Vector3};
use roadplane_base::Camera;

use crate::MetricsError;
use crate::text_file::read_text;

/// Camera 2 of a KITTI recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KittiCamera {
    /// The camera, a pinhole camera without distortion.
    pub camera: Camera,
    /// Position of the rectified camera 0 in camera 2's frame, m. It is `K⁻¹` times the last column of the projection
    /// `P2`, where K is the matrix of the pinhole camera.
    pub shift_m: Vector3<f64>,
}

impl KittiCamera {
    /// Creates a camera from its focal length (px), principal point (px) and shift (m).
    #[must_use]
    pub fn new(focal_px: f64, principal_point_px: [f64; 2], shift_m: Vector3<f64>) -> Self {
        Self { camera: Camera::pinhole(focal_px, Vector2::from(principal_point_px)), shift_m }
    }
}

/// Reads the line `P2:` (12 numbers, row by row) of a calibration file.
///
/// # Errors
/// [`MetricsError::Unreadable`]; [`MetricsError::Malformed`] if `P2` is missing or not valid, or if its pixels are not
/// square.
pub fn read_calib(path: &Path) -> Result<KittiCamera, MetricsError> {
    let text = read_text(path)?;
    let fail = |what: &str| MetricsError::malformed(path, format!("P2: {what}"));
    let line = text.lines().find_map(|line| line.strip_prefix("P2:")).ok_or_else(|| fail("is missing"))?;
    let numbers: Vec<f64> = line
        .split_whitespace()
        .map(|text| text.parse().ok().filter(|v: &f64| v.is_finite()))
        .collect::<Option<_>>()
        .ok_or_else(|| fail("has a field that is no finite number"))?;
    let Ok([fx, skew, cx, tx, _, fy, cy, ty, .., one, tz]) = <[f64; 12]>::try_from(numbers) else {
        return Err(fail("must have 12 numbers"));
    };
    if !(fx > 0.0 && (fx - fy).abs() < 1e-3 * fx && skew.abs() < 1e-6 && (one - 1.0).abs() < 1e-6) {
        return Err(fail("is not the rectified pinhole camera of the benchmark"));
    }
    // P2 = K [I | t], so its last column is K t.
    let shift_m = Vector3::new((tx - cx * tz) / fx, (ty - cy * tz) / fy, tz);
    Ok(KittiCamera::new(fx, [cx, cy], shift_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3x4, Vector4};

    /// A projection like those of the benchmark, with invented numbers. Camera 2 is 6 cm to the left of camera 0.
    const P2: &str =
        "7.2e+02 0.0e+00 6.1e+02 4.503e+01 0.0e+00 7.2e+02 1.7e+02 2.31e-01 0.0e+00 0.0e+00 1.0e+00 3.0e-03";

    fn of(text: &str) -> Result<KittiCamera, MetricsError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000001.txt");
        std::fs::write(&path, text).unwrap();
        read_calib(&path)
    }

    #[test]
    fn pixels_are_those_of_the_projection_matrix() {
        let camera = of(&format!("P0: 1 2 3\nP2: {P2}\nR0_rect: 1 0 0\n")).unwrap();
        let numbers: Vec<f64> = P2.split(' ').map(|v| v.parse().unwrap()).collect();
        let projected = Matrix3x4::from_row_slice(&numbers) * Vector4::new(-3.0, 1.6, 20.0, 1.0);
        let pixel =
            camera.camera.pixel_from_camera(&(Vector3::new(-3.0, 1.6, 20.0) + camera.shift_m)).unwrap();
        assert!((pixel - projected.xy() / projected.z).norm() < 1e-9);
        assert!(
            (camera.shift_m - Vector3::new(0.06, -0.00038750, 0.003)).norm() < 1e-5,
            "{}",
            camera.shift_m
        );
    }

    #[test]
    fn errors_name_the_fault() {
        for (text, word) in [
            ("P1: 1 2", "P2: is missing"),
            ("P2: 1 2", "12 numbers"),
            ("P2: 1 x", "no finite number"),
            ("P2: 700 0 600 40 0 900 170 0.2 0 0 1 0", "rectified"),
        ] {
            let error = of(text).unwrap_err().to_string();
            assert!(error.contains(word) && error.ends_with("000001.txt"), "{error}");
        }
    }
}
