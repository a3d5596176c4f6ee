//! One frame with its detected vehicles: a line of a frames file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::car::{CarRecord, WeakBox};
use super::error::RecordError;
use super::watch::WatchRecord;
use crate::{ImageSize, SceneCurve, SceneLine};

/// One frame with its vehicles and the results of the stages so far: a line of `frames.jsonl`. Unknown fields are kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "frames: one line per frame")]
pub struct FrameRecord {
    /// Index of the frame in its input, from 0.
    pub frame: u64,
    /// Presentation time of the frame, s.
    pub time_s: f64,
    /// Width and height of the frame, px.
    pub image_size_px: ImageSize,
    /// State of the camera, and changes of the picture. Absent if the camera was not monitored, for example in files of
    /// other tools. The camera then counts as stationary.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watch: Option<WatchRecord>,
    /// Straight edges of the scene that may be vertical, each `[x0, y0, x1, y1, sd]`. The numbers are both ends in px,
    /// and the sd of the direction in rad. The list is valid from this frame on, until the next list or a camera move.
    /// It is absent in frames in which the edges were not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_lines: Option<Vec<SceneLine>>,
    /// Long edges of the scene that show the lens distortion, each `[x0, y0, x1, y1, x2, y2, sd]` in px. The points are
    /// one end, the middle and the other end. `sd` is the sd of the distance between the middle and the line through
    /// the ends. The list is written together with `scene_lines`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_curves: Option<Vec<SceneCurve>>,
    /// Vehicles of the frame: detected in it, or carried over from an earlier frame.
    pub cars: Vec<CarRecord>,
    /// Weak boxes: detections with a score below the detector's threshold. The tracker can use them to continue a
    /// track.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub weak: Vec<WeakBox>,
    /// Fields that other tools added. They are written back unchanged.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

impl FrameRecord {
    /// Creates a frame without any results.
    #[must_use]
    pub fn empty(frame: u64, time_s: f64, image_size_px: ImageSize) -> Self {
        Self {
            frame,
            time_s,
            image_size_px,
            watch: None,
            scene_lines: None,
            scene_curves: None,
            cars: Vec::new(),
            weak: Vec::new(),
            extra: Map::new(),
        }
    }

    /// Returns the picture as a box in the pixels of the frame's vehicles. For a frame that was converted to the first
    /// picture of its camera, it is the part of the plane of that picture in view.
    #[must_use]
    pub fn picture_px(&self) -> [f64; 4] {
        let motion = self.watch.as_ref().and_then(|watch| watch.picture_from_world.as_ref());
        self.image_size_px.part_in_view_px(motion)
    }

    /// Reads one line and checks its numbers.
    ///
    /// All numbers must be finite, every box must have an area, and every sd must be above zero.
    ///
    /// # Errors
    /// Returns a [`RecordError`] that names the wrong field.
    pub fn from_json(line: &str) -> Result<Self, RecordError> {
        let record: Self = serde_json::from_str(line)?;
        let fail = |what: String| Err(RecordError::Unsuitable { what });
        if !record.time_s.is_finite() {
            return fail("time_s is not finite".to_owned());
        }
        if record.image_size_px.width == 0 || record.image_size_px.height == 0 {
            return fail("image_size_px must be positive".to_owned());
        }
        for (i, line) in record.scene_lines.iter().flatten().enumerate() {
            if !line.is_sound() {
                return fail(format!("scene_lines[{i}] is not finite, or has no length or no positive sd"));
            }
        }
        for (i, car) in record.cars.iter().enumerate() {
            if !is_box(&car.bbox_px) {
                return fail(format!("cars[{i}].bbox_px {:?} is not a box", car.bbox_px));
            }
            if !car.score.is_finite() {
                return fail(format!("cars[{i}].score is not finite"));
            }
            let points = car.keypoints.iter().flat_map(|set| set.iter().flatten());
            for point in points {
                let numbers = [point.pixel.x, point.pixel.y, point.score];
                let covariance = &point.covariance_px2;
                if !numbers.iter().chain(covariance.iter()).all(|v| v.is_finite())
                    || covariance.cholesky().is_none()
                {
                    return fail(format!(
                        "cars[{i}] has a keypoint that is not finite or has no positive sd"
                    ));
                }
            }
        }
        for (i, weak) in record.weak.iter().enumerate() {
            if !(is_box(&weak.bbox_px) && weak.score.is_finite()) {
                return fail(format!("weak[{i}] is not a box {:?} with a finite score", weak.bbox_px));
            }
        }
        Ok(record)
    }
}

fn is_box(bbox_px: &[f64; 4]) -> bool {
    let [x0, y0, x1, y1] = *bbox_px;
    bbox_px.iter().all(|v| v.is_finite()) && x1 > x0 && y1 > y0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::KEYPOINTS;
    use nalgebra::Matrix2;

    fn line(keypoint: &str) -> String {
        let nulls = vec!["null"; KEYPOINTS - 1].join(",");
        format!(
            r#"{{"frame":3,"time_s":0.1,"image_size_px":[640,480],"note":"kept","cars":[{{"bbox_px":[1,2,30,40],"score":0.9,"class":"car","keypoints":[{keypoint},{nulls}],"id":7}}]}}"#
        )
    }

    #[test]
    fn a_line_survives_with_unknown_fields() {
        let record = FrameRecord::from_json(&line("[10.5,20.25,0.75,1.5]")).unwrap();
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(FrameRecord::from_json(&text).unwrap(), record);
        assert!(text.contains(r#""note":"kept""#) && text.contains(r#""id":7"#));
        assert!(text.contains("[10.5,20.25,0.75,1.5]"), "{text}");
    }

    #[test]
    fn a_covariance_survives() {
        let mut record = FrameRecord::from_json(&line("[10.5,20.25,0.75,1.5]")).unwrap();
        if let Some(point) = record.cars[0].keypoints.as_mut().and_then(|set| set[0].as_mut()) {
            point.covariance_px2 = Matrix2::new(3.0, 0.5, 0.5, 1.5);
        }
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(FrameRecord::from_json(&text).unwrap(), record);
    }

    #[test]
    fn impossible_numbers_are_rejected() {
        assert!(FrameRecord::from_json(&line("[10.5,20.25,0.75,0.0]")).is_err());
        assert!(FrameRecord::from_json(&line("[10.5,20.25,0.75]")).is_err());
        assert!(FrameRecord::from_json(&line("null").replace("[1,2,30,40]", "[30,2,1,40]")).is_err());
        assert!(FrameRecord::from_json("").is_err());
        let lines =
            |lines: &str| line("null").replace(r#""note""#, &format!(r#""scene_lines":{lines},"note""#));
        assert!(FrameRecord::from_json(&lines("[[1.0,2.0,1.5,40.0,0.01]]")).is_ok());
        assert!(FrameRecord::from_json(&lines("[[1.0,2.0,1.0,2.0,0.01]]")).is_err());
        assert!(FrameRecord::from_json(&lines("[[1.0,2.0,1.5,40.0,0.0]]")).is_err());
    }
}
