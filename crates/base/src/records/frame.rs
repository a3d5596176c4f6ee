//! A line of a frames file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::car::{CarRecord, WeakBox};
use super::error::RecordError;
use super::watch::WatchRecord;
use crate::{ImageSize, SceneCurve, SceneLine};

/// One line of a frames file: what is known of one frame so far. Fields that we do not know are kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameRecord {
    /// Index of the frame in its input.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Width and height, px.
    pub image_size_px: ImageSize,
    /// What the picture says of the camera and of change; absent before that stage and from other tools.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watch: Option<WatchRecord>,
    /// Straight edges of the place that may be vertical, `[x0, y0, x1, y1, sd]` each, as they are known from this frame on until
    /// the camera is moved; absent where nobody looked for them anew.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_lines: Option<Vec<SceneLine>>,
    /// Long edges that show how the lens bends lines, `[x0, y0, x1, y1, x2, y2, sd]` each: ends and middle; told with `scene_lines`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_curves: Option<Vec<SceneCurve>>,
    /// Vehicles found.
    pub cars: Vec<CarRecord>,
    /// Boxes of too low a score to say that something is a vehicle: where one that is known is expected, it may be it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub weak: Vec<WeakBox>,
    /// Fields of other tools.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

impl FrameRecord {
    /// A frame of which nothing is known yet.
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

    /// Reads one line and checks its numbers: finite, boxes with an area, sd above zero.
    ///
    /// # Errors
    /// [`RecordError`] that says which field is wrong.
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
                return fail(format!("scene_lines[{i}] is not finite, has no length or no positive sd"));
            }
        }
        for (i, car) in record.cars.iter().enumerate() {
            if !is_box(&car.bbox_px) {
                return fail(format!("cars[{i}].bbox_px {:?} is no box", car.bbox_px));
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
                return fail(format!("weak[{i}] is no box {:?} with a score", weak.bbox_px));
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
    fn impossible_numbers_are_refused() {
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
