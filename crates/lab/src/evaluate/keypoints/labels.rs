//! Reads the hand-labelled cars of an image from a JSON file of this form:
//!
//! ```text
//! {"image", "cars": [{"box": [x0, y0, x1, y1], "type", "facing", "keypoints": {name: [x, y, flag]}}]}
//! ```
//!
//! Positions are in px. Flag 2 marks a clearly visible keypoint. Flag 1 marks a hidden or blurred keypoint, which the
//! annotator placed by judgement. A keypoint without an entry has no label.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Vector2;
use roadplane_base::{KEYPOINTS, keypoint_names};
use serde::Deserialize;

use crate::LabError;
use roadplane_metrics::text_file::read_text;

/// A labelled keypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Label {
    /// Position, px.
    pub pixel: Vector2<f64>,
    /// Whether the keypoint is clearly visible. With `false`, the keypoint is hidden or blurred, and the annotator
    /// placed it by judgement.
    pub clear: bool,
}

/// A labelled car.
#[derive(Clone, Debug)]
pub struct LabelledCar {
    /// The car's box: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Body type, such as `suv`; empty if the file has none.
    pub body: String,
    /// Labels by keypoint index; `None` for a keypoint without a label.
    pub labels: [Option<Label>; KEYPOINTS],
}

/// The labels of an image.
#[derive(Clone, Debug)]
pub struct LabelledImage {
    /// File name of the image.
    pub image: PathBuf,
    /// The labelled cars of the image.
    pub cars: Vec<LabelledCar>,
}

#[derive(Deserialize)]
struct File {
    image: PathBuf,
    cars: Vec<Car>,
}

#[derive(Deserialize)]
struct Car {
    #[serde(rename = "box")]
    bbox_px: [f64; 4],
    #[serde(default, rename = "type")]
    body: String,
    keypoints: BTreeMap<String, [f64; 3]>,
}

impl LabelledImage {
    /// Reads a label file.
    ///
    /// # Errors
    /// [`MetricsError::Unreadable`](roadplane_metrics::MetricsError) if the file cannot be read.
    /// [`MetricsError::Malformed`](roadplane_metrics::MetricsError) if the content is wrong; the message names the car
    /// and the keypoint.
    pub fn read(path: &Path) -> Result<Self, LabError> {
        let file: File =
            serde_json::from_str(&read_text(path)?).map_err(|error| LabError::malformed(path, error))?;
        let read = |(number, car): (usize, Car)| {
            checked(car).map_err(|what| LabError::malformed(path, format!("car {number}: {what}")))
        };
        let cars = file.cars.into_iter().enumerate().map(read).collect::<Result<_, _>>()?;
        Ok(Self { image: file.image, cars })
    }
}

fn checked(car: Car) -> Result<LabelledCar, String> {
    let [x0, y0, x1, y1] = car.bbox_px;
    let area = (x1 - x0).min(y1 - y0);
    if !(area > 0.0 && car.bbox_px.iter().all(|v| v.is_finite())) {
        return Err("the box has no area".to_owned());
    }
    let mut labels = [None; KEYPOINTS];
    for (name, [x, y, flag]) in car.keypoints {
        let index = keypoint_names()
            .iter()
            .position(|listed| *listed == name)
            .ok_or_else(|| format!("{name} is no keypoint's name"))?;
        if !(x.is_finite() && y.is_finite() && [1.0, 2.0].contains(&flag)) {
            return Err(format!("{name}: [x, y, flag] with flag 1 or 2 expected"));
        }
        labels[index] = Some(Label { pixel: Vector2::new(x, y), clear: flag == 2.0 });
    }
    Ok(LabelledCar { bbox_px: car.bbox_px, body: car.body, labels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<LabelledImage, LabError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("labels.json");
        std::fs::write(&path, text).unwrap();
        LabelledImage::read(&path)
    }

    #[test]
    fn labels_come_in_by_index() {
        let image = read(
            r#"{"image": "a.png", "cars": [{"box": [1, 2, 30, 20], "type": "suv",
                "keypoints": {"left_wheel_front": [3.5, 4, 2], "right_wheel_front": [9, 8, 1]}}]}"#,
        )
        .unwrap();
        let car = &image.cars[0];
        assert_eq!(car.labels[0], Some(Label { pixel: Vector2::new(3.5, 4.0), clear: true }));
        assert!(car.labels[18].is_some_and(|label| !label.clear));
        assert_eq!(car.labels.iter().flatten().count(), 2);
    }

    #[test]
    fn wrong_labels_are_named() {
        for (text, named) in [
            ("[", "EOF"),
            (r#"{"image": "a", "cars": [{"box": [1, 2, 1, 20], "keypoints": {}}]}"#, "car 0: the box"),
            (r#"{"image": "a", "cars": [{"box": [1, 2, 9, 9], "keypoints": {"nose": [1, 1, 2]}}]}"#, "nose"),
            (
                r#"{"image": "a", "cars": [{"box": [1, 2, 9, 9], "keypoints": {"left_mirror": [1, 1, 3]}}]}"#,
                "left_mirror",
            ),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
    }
}
