//! Reads and checks truth files. An error in the truth would make all scores wrong.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use nalgebra::Matrix3;
use roadplane_base::KEYPOINTS;
use serde::de::DeserializeOwned;

use super::{DATASET_SCHEMA, Dataset, Rows, TRUTH_SCHEMA, Truth};
use crate::MetricsError;
use crate::text_file::read_text;

/// Tolerance of the checks of rotations and planes, whose values are rounded in files.
const ROUNDING: f64 = 1e-4;

/// Reads `dataset.json` from the folder of a data set. Paths of items in the result include the folder.
///
/// # Errors
/// [`MetricsError::Unreadable`], or [`MetricsError::Malformed`], which names the field.
pub fn read_dataset(folder: &Path) -> Result<Dataset, MetricsError> {
    let path = folder.join("dataset.json");
    let mut dataset: Dataset = parse(&path)?;
    if dataset.schema != DATASET_SCHEMA {
        let what = format!("schema: is {:?}, expected {DATASET_SCHEMA:?}", dataset.schema);
        return Err(MetricsError::malformed(&path, what));
    }
    let outside = |item: &PathBuf| item.components().any(|c| !matches!(c, std::path::Component::Normal(_)));
    if let Some(item) = dataset.items.iter().find(|item| outside(item)) {
        return Err(MetricsError::malformed(
            &path,
            format!("items: {} lies outside the folder", item.display()),
        ));
    }
    if !dataset.items.is_sorted() {
        return Err(MetricsError::malformed(&path, "items: not sorted"));
    }
    dataset.items = dataset.items.iter().map(|item| folder.join(item)).collect();
    Ok(dataset)
}

/// Reads one truth file, gzipped or not. The path `media` in the result includes the folder of the file.
///
/// # Errors
/// [`MetricsError::Unreadable`], or [`MetricsError::Malformed`], which names the field.
pub fn read_truth(path: &Path) -> Result<Truth, MetricsError> {
    let mut truth: Truth = parse(path)?;
    check(&truth).map_err(|what| MetricsError::malformed(path, what))?;
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    truth.media = truth.media.map(|media| folder.join(media));
    Ok(truth)
}

/// Returns the name of a scene: `clip_0000` for `scenes/clip_0000.truth.json.gz`.
#[must_use]
pub fn scene_name(truth: &Path) -> String {
    let name = truth.file_name().unwrap_or(truth.as_os_str()).to_string_lossy();
    let plain = name.strip_suffix(".gz").unwrap_or(&name);
    plain.strip_suffix(".truth.json").unwrap_or(plain).to_owned()
}

fn parse<T: DeserializeOwned>(path: &Path) -> Result<T, MetricsError> {
    serde_json::from_str(&read_text(path)?).map_err(|e| MetricsError::malformed(path, e))
}

fn check(truth: &Truth) -> Result<(), String> {
    let fail = |field: &str, what: &str| Err(format!("{field}: {what}"));
    if truth.schema != TRUTH_SCHEMA {
        return fail("schema", &format!("is {:?}, expected {TRUTH_SCHEMA:?}", truth.schema));
    }
    let camera = &truth.camera;
    if camera.image_size_px.width == 0 || camera.image_size_px.height == 0 {
        return fail("camera.image_size_px", "must be positive");
    }
    if !(camera.focal_px.is_finite() && camera.focal_px > 0.0) {
        return fail("camera.focal_px", "must be positive");
    }
    if !(camera.height_m.is_finite() && camera.height_m > 0.0) {
        return fail("camera.height_m", "must be positive");
    }
    rigid(&camera.camera_from_world).map_err(|what| format!("camera.camera_from_world: {what}"))?;
    // The file describes the same plane three times, and the three descriptions must agree.
    let plane = camera.plane();
    let same_angle = |a: f64, b: f64| (a - b).abs() < ROUNDING;
    if !same_angle(plane.tilt(), camera.tilt_rad) || !same_angle(plane.roll(), camera.roll_rad) {
        return fail("camera.plane_in_camera", "disagrees with tilt_rad and roll_rad");
    }
    let exact = plane.camera_from_world();
    let stated = super::isometry_from_rows(&camera.camera_from_world);
    if (plane.height_m - camera.height_m).abs() > 1e-3
        || exact.rotation.angle_to(&stated.rotation) > 1e-3
        || (exact.translation.vector - stated.translation.vector).norm() > 1e-2
    {
        return fail("camera.camera_from_world", "disagrees with plane_in_camera");
    }
    let mut ids = BTreeSet::new();
    for (i, model) in truth.models.iter().enumerate() {
        if !ids.insert(model.id) {
            return fail(&format!("models[{i}].id"), "appears twice");
        }
        if model.keypoints_in_car.len() != KEYPOINTS {
            return fail(&format!("models[{i}].keypoints_in_car"), &format!("must have {KEYPOINTS} entries"));
        }
        if !model.dims_m.iter().all(|d| d.is_finite() && *d > 0.0) {
            return fail(&format!("models[{i}].dims_m"), "must be positive");
        }
    }
    if !truth.frames.is_sorted_by(|a, b| a.frame < b.frame) {
        return fail("frames", "not in ascending order");
    }
    for (f, frame) in truth.frames.iter().enumerate() {
        let mut seen = BTreeSet::new();
        for (c, car) in frame.cars.iter().enumerate() {
            let field = |name: &str| format!("frames[{f}].cars[{c}].{name}");
            if !ids.contains(&car.id) || !seen.insert(car.id) {
                return fail(&field("id"), "is the id of no model, or is used twice in the frame");
            }
            rigid(&car.world_from_car).map_err(|what| format!("{}: {what}", field("world_from_car")))?;
            let [x0, y0, x1, y1] = car.bbox_px;
            if !(car.bbox_px.iter().all(|v| v.is_finite()) && x1 > x0 && y1 > y0) {
                return fail(&field("box"), "is no box");
            }
            if car.keypoints_px.len() != KEYPOINTS {
                return fail(&field("keypoints_px"), &format!("must have {KEYPOINTS} entries"));
            }
            if !(0.0..=1.0).contains(&car.visible_share) {
                return fail(&field("visible_share"), "must lie in 0–1");
            }
        }
    }
    Ok(())
}

/// Checks that a 4 × 4 matrix consists of a rotation and a translation.
fn rigid(rows: &Rows) -> Result<(), &'static str> {
    let r = Matrix3::from_fn(|i, j| rows[i][j]);
    let last = rows[3].iter().zip([0.0, 0.0, 0.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-9);
    if !(rows.iter().flatten().all(|v| v.is_finite()) && last) {
        return Err("is no rigid motion");
    }
    let off = (r * r.transpose() - Matrix3::identity()).norm();
    if off > ROUNDING || r.determinant() < 0.0 {
        Err("its rotation is no rotation: not orthonormal, or mirrored")
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};
    use std::io::Read as _;

    /// Returns a truth file with one car. The car is 10 m ahead of a camera that is 5 m above the ground and tilted by
    /// 0.3 rad.
    fn truth() -> Value {
        let plane = roadplane_base::GroundPlane::from_tilt_roll_height(0.3, 0.05, 5.0);
        let rows = roadplane_base::rows_from_isometry(&plane.camera_from_world());
        let n = plane.normal_in_camera;
        json!({
            "schema": TRUTH_SCHEMA, "media": null, "kind": "still", "fps": null, "real": false,
            "conditions": {"weather": "sun"},
            "camera": {"image_size_px": [1280, 720], "focal_px": 1000.0, "principal_point_px": [639.5, 359.5],
                "height_m": 5.0, "tilt_rad": 0.3, "roll_rad": 0.05,
                "plane_in_camera": {"normal": [n.x, n.y, n.z], "offset_m": 5.0}, "camera_from_world": rows},
            "models": [{"id": 4, "class": "car", "body": "sedan", "model": "m", "dims_m": [4.5, 1.8, 1.4],
                "keypoints_in_car": vec![Value::Null; KEYPOINTS]}],
            "frames": [{"frame": 0, "time_s": 0.0, "cars": [{"id": 4,
                "world_from_car": [[0, -1, 0, 1.5], [1, 0, 0, 10], [0, 0, 1, 0], [0, 0, 0, 1]],
                "speed_mps": 0.0, "activity": "u_turn", "box": [1, 2, 30, 40], "whole_box": [1, 2, 30, 40],
                "visible_share": 0.5, "keypoints_px": vec![Value::Null; KEYPOINTS]}]}]
        })
    }

    fn read(value: &Value) -> Result<Truth, MetricsError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("0000.truth.json");
        std::fs::write(&path, value.to_string()).unwrap();
        read_truth(&path)
    }

    #[test]
    fn a_truth_is_read() {
        let truth = read(&truth()).unwrap();
        let car = &truth.frames[0].cars[0];
        let in_camera = truth.camera.camera_from_car(car);
        // The camera is 5 m above the world's origin.
        assert!((in_camera.translation.vector.norm() - (1.5f64.powi(2) + 100.0 + 25.0).sqrt()).abs() < 1e-9);
        assert!(in_camera.translation.vector.z > 0.0);
        assert_eq!(truth.model(4).unwrap().body, "sedan");
    }

    #[test]
    fn a_gzipped_truth_is_read_and_a_truncated_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("0000.truth.json.gz");
        let mut packed = Vec::new();
        let text = truth().to_string();
        flate2::read::GzEncoder::new(text.as_bytes(), flate2::Compression::best())
            .read_to_end(&mut packed)
            .unwrap();
        std::fs::write(&path, &packed).unwrap();
        assert_eq!(read_truth(&path).unwrap().models[0].id, 4);
        for end in (0..packed.len()).step_by(37) {
            std::fs::write(&path, &packed[..end]).unwrap();
            assert!(read_truth(&path).unwrap_err().to_string().ends_with("0000.truth.json.gz"));
        }
    }

    #[test]
    fn errors_name_the_field() {
        for (pointer, wrong, word) in [
            ("/schema", json!("other/1"), "schema"),
            ("/camera/focal_px", json!(-1.0), "camera.focal_px"),
            ("/camera/tilt_rad", json!(0.4), "plane_in_camera"),
            ("/camera/height_m", json!(6.0), "camera_from_world"),
            ("/models/0/keypoints_in_car", json!([]), "models[0].keypoints_in_car"),
            ("/frames/0/cars/0/id", json!(5), "frames[0].cars[0].id"),
            ("/frames/0/cars/0/box", json!([3, 2, 1, 4]), "frames[0].cars[0].box"),
            ("/frames/0/cars/0/world_from_car/0/0", json!(2), "frames[0].cars[0].world_from_car"),
            ("/frames/0/cars/0/activity", json!("flying"), "activity"),
        ] {
            let mut value = truth();
            *value.pointer_mut(pointer).unwrap() = wrong;
            let error = read(&value).unwrap_err().to_string();
            assert!(error.contains(word) || error.contains("flying"), "{pointer}: {error}");
            assert!(error.ends_with("0000.truth.json"), "{error}");
        }
    }

    #[test]
    fn a_list_stays_in_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let list = |items: Value| {
            let value =
                json!({"schema": DATASET_SCHEMA, "name": "lots", "split": "eval", "seed": 1, "items": items});
            std::fs::write(folder.path().join("dataset.json"), value.to_string()).unwrap();
            read_dataset(folder.path())
        };
        let dataset = list(json!(["scenes/0000.truth.json", "scenes/0001.truth.json"])).unwrap();
        assert_eq!(dataset.items[1], folder.path().join("scenes/0001.truth.json"));
        assert!(
            list(json!(["../0000.truth.json"])).unwrap_err().to_string().contains("lies outside the folder")
        );
        assert!(list(json!(["b", "a"])).unwrap_err().to_string().contains("not sorted"));
    }
}
