//! Reads reference cameras: real ones from `cameras.json` (schema `roadplane.cameras/1`), rendered ones from the truth
//! files of a data set.
//!
//! For each picture or clip, `cameras.json` gives the focal length, the ground plane and the lens distortion, with
//! their standard deviations. Rendered cameras are exact.

use std::path::{Path, PathBuf};

use nalgebra::{Vector2, Vector3};
use roadplane_base::{Camera, GroundPlane, ImageSize, Lens};
use serde::Deserialize;

use crate::MetricsError;
use crate::text_file::read_text;
use crate::truth::{Truth, read_dataset, read_truth, scene_name};

/// Schema id of the file `cameras.json`.
const SCHEMA: &str = "roadplane.cameras/1";
/// Largest absolute value of k1 at which a lens is treated as free of distortion.
const STRAIGHT: f64 = 0.05;

/// A camera with a given focal length, ground plane and lens distortion.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceCamera {
    /// Source and name of the camera, written as `source/name`.
    pub id: String,
    /// Path of the camera's picture or clip.
    pub media: PathBuf,
    /// Size of the picture.
    pub size: ImageSize,
    /// Focal length, px.
    pub focal_px: f64,
    /// Principal point, px.
    pub principal_point_px: Vector2<f64>,
    /// The ground plane.
    pub plane: GroundPlane,
    /// Coefficients k1 and k2 of radial distortion (OpenCV's model).
    pub distortion: [f64; 2],
    /// Standard deviations of the reference values: log focal length, tilt (rad), roll (rad), log height.
    pub sd: [f64; 4],
}

impl ReferenceCamera {
    /// Returns the camera with its lens distortion.
    #[must_use]
    pub fn camera(&self) -> Camera {
        let [k1, k2] = self.distortion;
        let lens = Lens::from_opencv(k1, k2, self.focal_px, self.size);
        Camera { lens, ..Camera::pinhole(self.focal_px, self.principal_point_px) }
    }

    /// Returns the camera of a rendered scene; `None` for a scene without a picture, without a vehicle, or with a camera
    /// that turns.
    fn of_truth(truth: &Truth, id: String) -> Option<Self> {
        let seen = truth.frames.iter().any(|frame| !frame.cars.is_empty());
        let turns = truth.frames.iter().any(|frame| frame.picture_from_world.is_some());
        if !seen || turns {
            return None;
        }
        Some(Self {
            id,
            media: truth.media.clone()?,
            size: truth.camera.image_size_px,
            focal_px: truth.camera.focal_px,
            principal_point_px: truth.camera.principal_point_px.into(),
            plane: truth.camera.plane(),
            distortion: [0.0; 2],
            sd: [0.0; 4],
        })
    }

    /// Returns whether the lens has hardly any distortion.
    #[must_use]
    pub fn is_straight(&self) -> bool {
        self.distortion[0].abs() <= STRAIGHT
    }
}

#[derive(Deserialize)]
struct File {
    schema: String,
    cameras: Vec<Entry>,
}

#[derive(Deserialize)]
struct Entry {
    id: String,
    file: PathBuf,
    image_size_px: [u32; 2],
    focal_px: f64,
    principal_point_px: [f64; 2],
    distortion_k1_k2: [f64; 2],
    height_m: f64,
    normal_in_camera: [f64; 3],
    sd: Sd,
}

#[derive(Deserialize)]
struct Sd {
    focal_share: f64,
    tilt_deg: f64,
    roll_deg: f64,
    height_share: f64,
}

/// Reads the cameras of a folder with `cameras.json`, or of a rendered data set (`dataset.json`).
///
/// Scenes of a data set that cannot serve are left out: those without a picture or vehicle, and those whose camera
/// turns.
///
/// # Errors
/// The errors of [`read_cameras`], [`read_dataset`] and [`read_truth`].
pub fn read_camera_folder(folder: &Path) -> Result<Vec<ReferenceCamera>, MetricsError> {
    if !folder.join("dataset.json").is_file() {
        return read_cameras(&folder.join("cameras.json"));
    }
    let dataset = read_dataset(folder)?;
    let mut cameras = Vec::new();
    for item in &dataset.items {
        let id = format!("{}/{}", dataset.name, scene_name(item));
        cameras.extend(ReferenceCamera::of_truth(&read_truth(item)?, id));
    }
    Ok(cameras)
}

/// Reads `cameras.json`. Media paths in the file are relative to the folder of the file. The returned paths include
/// that folder.
///
/// # Errors
/// [`MetricsError::Unreadable`]; [`MetricsError::Malformed`] for another schema or an invalid number. Focal lengths,
/// heights and the lengths of normals must be finite and positive.
pub fn read_cameras(path: &Path) -> Result<Vec<ReferenceCamera>, MetricsError> {
    let text = read_text(path)?;
    let file: File =
        serde_json::from_str(&text).map_err(|error| MetricsError::malformed(path, error.to_string()))?;
    if file.schema != SCHEMA {
        return Err(MetricsError::malformed(path, format!("schema {:?}, expected {SCHEMA:?}", file.schema)));
    }
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    let camera = |entry: Entry| {
        let normal = Vector3::from(entry.normal_in_camera);
        let numbers = [entry.focal_px, entry.height_m, normal.norm()];
        if !numbers.iter().all(|number| number.is_finite() && *number > 0.0) {
            return Err(MetricsError::malformed(
                path,
                format!("{}: focal_px, height_m and normal_in_camera must be finite, above 0", entry.id),
            ));
        }
        let [width, height] = entry.image_size_px;
        let Sd { focal_share, tilt_deg, roll_deg, height_share } = entry.sd;
        Ok(ReferenceCamera {
            media: folder.join(entry.file),
            id: entry.id,
            size: ImageSize { width, height },
            focal_px: entry.focal_px,
            principal_point_px: entry.principal_point_px.into(),
            plane: GroundPlane { normal_in_camera: normal / normal.norm(), height_m: entry.height_m },
            distortion: entry.distortion_k1_k2,
            sd: [focal_share, tilt_deg.to_radians(), roll_deg.to_radians(), height_share],
        })
    };
    file.cameras.into_iter().map(camera).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_read_and_invalid_values_are_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cameras.json");
        let text = |focal: &str, schema: &str| {
            format!(
                r#"{{"schema": "{schema}", "cameras": [{{"id": "a/b", "file": "b.jpg", "image_size_px": [640, 360],
                "focal_px": {focal}, "principal_point_px": [320, 180], "distortion_k1_k2": [-0.3, 0.1], "height_m": 8.0, "normal_in_camera": [0, -2, 0],
                "sd": {{"focal_share": 0.01, "tilt_deg": 1, "roll_deg": 1, "height_share": 0.1}}, "quality": "good"}}]}}"#
            )
        };
        std::fs::write(&path, text("700", SCHEMA)).unwrap();
        let cameras = read_cameras(&path).unwrap();
        assert_eq!(cameras[0].media, folder.path().join("b.jpg"));
        assert!((cameras[0].plane.normal_in_camera.y + 1.0).abs() < 1e-12);
        for broken in [text("-1", SCHEMA), text("700", "other/1"), "{".to_owned()] {
            std::fs::write(&path, broken).unwrap();
            assert!(matches!(read_cameras(&path), Err(MetricsError::Malformed { .. })));
        }
    }

    #[test]
    fn the_scenes_of_a_data_set_are_cameras() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/lots");
        let cameras = read_camera_folder(&folder).unwrap();
        let dataset = read_dataset(&folder).unwrap();
        assert_eq!(cameras.len(), dataset.items.len());
        let truth = read_truth(&dataset.items[0]).unwrap();
        assert_eq!(Some(&cameras[0].media), truth.media.as_ref());
        assert_eq!((cameras[0].focal_px, cameras[0].sd), (truth.camera.focal_px, [0.0; 4]));
        assert_eq!(cameras[0].plane, truth.camera.plane());
    }
}
