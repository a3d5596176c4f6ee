//! Reads MEVA's `.krtd` cameras (Kitware's KWIVER).
//!
//! A file contains K, R, T and the lens distortion, separated by whitespace; `X_camera = R X_world + T`. Lengths are in
//! metres, and z = 0 is roughly the ground.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use roadplane_base::GroundPlane;
use roadplane_write::WriteError;

/// A calibrated camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Krtd {
    /// Focal length along x, px. In some files the pixels are not square.
    pub focal_x_px: f64,
    /// Focal length along y, px.
    pub focal_y_px: f64,
    /// Principal point (x, y), px.
    pub principal_point_px: [f64; 2],
    /// The ground z = 0 of the world in the camera frame: tilt, roll and height.
    pub plane: GroundPlane,
    /// Lens distortion in OpenCV's order (k1, k2, p1, p2, k3), as many numbers as the file has.
    pub distortion: Vec<f64>,
}

impl Krtd {
    /// Returns the geometric mean of the two focal lengths, px: the focal length of square pixels of the same area.
    #[must_use]
    pub fn focal_px(&self) -> f64 {
        (self.focal_x_px * self.focal_y_px).sqrt()
    }
}

/// Reads a camera from a `.krtd` file.
///
/// # Errors
/// [`WriteError::Io`]; [`WriteError::Malformed`] if the file is no K, R, T with a rotation, or the camera is under the
/// ground.
pub fn read_krtd(path: &Path) -> Result<Krtd, WriteError> {
    let text = std::fs::read_to_string(path).map_err(WriteError::io("read", path))?;
    let fail = |what: &str| WriteError::malformed(path, what);
    let numbers: Vec<f64> = text
        .split_whitespace()
        .map(|text| text.parse().ok().filter(|v: &f64| v.is_finite()))
        .collect::<Option<_>>()
        .ok_or_else(|| fail("a field is no finite number"))?;
    if numbers.len() < 21 {
        return Err(fail("K, R and T need 21 numbers"));
    }
    let (k, rest) = numbers.split_at(9);
    let (r, rest) = rest.split_at(9);
    let (t, distortion) = rest.split_at(3);
    let rotation = Matrix3::from_row_slice(r);
    if !(k[0] > 0.0 && k[4] > 0.0 && (k[8] - 1.0).abs() < 1e-9) {
        return Err(fail("K: no matrix of a pinhole camera"));
    }
    if (rotation * rotation.transpose() - Matrix3::identity()).norm() > 1e-6 || rotation.determinant() < 0.0 {
        return Err(fail("R: no rotation matrix"));
    }
    let up = rotation.column(2).into_owned();
    // The camera's centre is −Rᵀ T; its height is the z of that vector.
    let height_m = -up.dot(&Vector3::from_row_slice(t));
    if height_m.is_nan() || height_m <= 0.0 {
        return Err(fail("the camera is not above z = 0"));
    }
    Ok(Krtd {
        focal_x_px: k[0],
        focal_y_px: k[4],
        principal_point_px: [k[2], k[5]],
        plane: GroundPlane { normal_in_camera: up, height_m },
        distortion: distortion.to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_of_given_tilt_and_height() {
        // The camera is 10 m up, looks along world y, 0.3 rad down, without roll.
        let plane = GroundPlane::from_tilt_roll_height(0.3, 0.0, 10.0);
        let m = plane.camera_from_world().to_homogeneous();
        let rows = |r: usize| format!("{} {} {}", m[(r, 0)], m[(r, 1)], m[(r, 2)]);
        let text = format!(
            "1500 0 960\n0 1400 540\n0 0 1\n\n{}\n{}\n{}\n\n{} {} {}\n\n-0.3 0.1 0 0 0",
            rows(0),
            rows(1),
            rows(2),
            m[(0, 3)],
            m[(1, 3)],
            m[(2, 3)]
        );
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.krtd");
        std::fs::write(&path, &text).unwrap();
        let camera = read_krtd(&path).unwrap();
        assert!((camera.plane.tilt() - 0.3).abs() < 1e-12 && camera.plane.roll().abs() < 1e-12);
        assert!((camera.plane.height_m - 10.0).abs() < 1e-12);
        assert!((camera.focal_px() - 2.1e6f64.sqrt()).abs() < 1e-9);
        assert_eq!(camera.distortion.len(), 5);
        for (broken, word) in [
            (text.replacen("1500", "-1500", 1), "K:"),
            (text.replacen("1500", "wide", 1), "no finite number"),
            (text.replacen(&rows(0), "1 1 1", 1), "R:"),
            ("1 2 3".to_owned(), "21 numbers"),
        ] {
            std::fs::write(&path, broken).unwrap();
            let error = read_krtd(&path).unwrap_err().to_string();
            assert!(error.contains(word) && error.ends_with("a.krtd"), "{error}");
        }
    }

    #[test]
    #[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
    fn real_cameras_are_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/meva");
        let camera = read_krtd(&folder.join("G424.krtd")).unwrap();
        let plane = camera.plane;
        assert!((camera.focal_px() - 4005.0).abs() < 0.5, "{}", camera.focal_px());
        assert!((plane.tilt().to_degrees() - 7.29).abs() < 0.005, "{}", plane.tilt().to_degrees());
        assert!((plane.height_m - 10.2).abs() < 0.05, "{}", plane.height_m);
        let mut read = 0;
        for entry in std::fs::read_dir(folder.join("activities/krtd")).unwrap() {
            let plane = read_krtd(&entry.unwrap().path()).unwrap().plane;
            assert!(
                (1.5..40.0).contains(&plane.height_m) && (-0.1..1.2).contains(&plane.tilt()),
                "{plane:?}"
            );
            read += 1;
        }
        assert!(read > 10, "{read}");
    }
}
