//! A detected vehicle in a frame: an entry of `cars` in a frames file.

use nalgebra::{Matrix2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::error::RecordError;
use super::vehicle_class::VehicleClass;
use crate::{KEYPOINTS, Keypoint, KeypointSet};

/// One detected vehicle in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "CarFields", into = "CarFields")]
pub struct CarRecord {
    /// Box: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Score of the detector, 0 to 1.
    pub score: f64,
    /// Class of the vehicle.
    pub class: VehicleClass,
    /// Keypoints; absent before the keypoint stage and if the pose is carried over.
    pub keypoints: Option<Box<KeypointSet>>,
    /// Frame from which the box is carried over: nothing has changed there since the detector found it.
    pub held_since: Option<u64>,
    /// Observation from which the pose is carried over: the car has not moved since.
    pub pose_from: Option<CarRef>,
    /// Earlier observation with keypoints. It is so recent that new keypoints would add no information.
    pub seen_after: Option<CarRef>,
    /// Fields of other tools, kept as they are.
    pub extra: Map<String, Value>,
}

/// A weak box: a detection with a score below the detector's threshold (`weak` in a frames file).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WeakBox {
    /// Box: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Score of the detector, 0 to 1. It is below the detector's threshold.
    #[schemars(range(min = 0, max = 1))]
    pub score: f64,
}

/// A reference `[frame, car]` to a vehicle of a frame: index of the frame, and index in its list `cars`, both from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(from = "(u64, usize)", into = "(u64, usize)")]
pub struct CarRef {
    /// Index of the frame.
    pub frame: u64,
    /// Index in the frame's list of cars.
    pub car: usize,
}

impl From<(u64, usize)> for CarRef {
    fn from((frame, car): (u64, usize)) -> Self {
        Self { frame, car }
    }
}

impl From<CarRef> for (u64, usize) {
    fn from(reference: CarRef) -> Self {
        (reference.frame, reference.car)
    }
}

impl CarRecord {
    /// Creates a car with only a box.
    #[must_use]
    pub fn boxed(bbox_px: [f64; 4]) -> Self {
        Self {
            bbox_px,
            score: 1.0,
            class: VehicleClass::Car,
            keypoints: None,
            held_since: None,
            pose_from: None,
            seen_after: None,
            extra: Map::new(),
        }
    }

    /// Returns the longer side of the box, px.
    #[must_use]
    pub fn longer_side_px(&self) -> f64 {
        let [x0, y0, x1, y1] = self.bbox_px;
        (x1 - x0).max(y1 - y0)
    }
}

/// One detected vehicle in one frame.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Car")]
struct CarFields {
    /// Box: left, top, right, bottom, px.
    bbox_px: [f64; 4],
    /// Score of the detector, 0 to 1.
    #[schemars(range(min = 0, max = 1))]
    score: f64,
    /// Class of the vehicle.
    class: VehicleClass,
    /// The 36 keypoints, each `[x, y, score, sd]`: x, y and sd in px, score from 0 to 1. A keypoint without a
    /// measurement is null. The sd holds for all directions, unless `keypoint_covariances_px2` has an entry. The list
    /// is absent before the keypoint stage, and if the pose is carried over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    keypoints: Option<Vec<Option<[f64; 4]>>>,
    /// Covariances `[xx, xy, yy]` of the 36 keypoints, px². The list is present if an sd differs by direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    keypoint_covariances_px2: Option<Vec<Option<[f64; 3]>>>,
    /// Index of the frame from which the box is carried over. Nothing has changed there since the detector found the
    /// box. Absent if the detector found the box in this frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    held_since: Option<u64>,
    /// Observation `[frame, car]` from which the pose is carried over: the index of its frame, and the index in that
    /// frame's `cars`. The vehicle has not moved since.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pose_from: Option<CarRef>,
    /// Earlier observation `[frame, car]` that has keypoints. It is so recent that new keypoints would add no
    /// information. So the keypoint net skipped the vehicle in this frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seen_after: Option<CarRef>,
    #[serde(flatten)]
    extra: Map<String, Value>,
}

/// Returns a pixel coordinate rounded as in files, to 0.0001 px, far below any keypoint's sd.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

impl From<CarRecord> for CarFields {
    fn from(car: CarRecord) -> Self {
        let row = |p: &Keypoint| [p.pixel.x, p.pixel.y, p.score, p.sd_px()].map(rounded);
        let covariance = |p: &Keypoint| {
            let c = &p.covariance_px2;
            [c[(0, 0)], c[(0, 1)], c[(1, 1)]].map(rounded)
        };
        let isotropic = |p: &Keypoint| {
            let c = &p.covariance_px2;
            c[(0, 0)].to_bits() == c[(1, 1)].to_bits() && c[(0, 1)].abs() < f64::EPSILON
        };
        let set = car.keypoints.as_deref();
        let directed = set.filter(|set| !set.iter().flatten().all(isotropic));
        Self {
            bbox_px: car.bbox_px,
            score: car.score,
            class: car.class,
            keypoints: set.map(|set| set.iter().map(|p| p.as_ref().map(row)).collect()),
            keypoint_covariances_px2: directed
                .map(|set| set.iter().map(|p| p.as_ref().map(covariance)).collect()),
            held_since: car.held_since,
            pose_from: car.pose_from,
            seen_after: car.seen_after,
            extra: car.extra,
        }
    }
}

impl TryFrom<CarFields> for CarRecord {
    type Error = RecordError;

    fn try_from(fields: CarFields) -> Result<Self, RecordError> {
        let of_36 = |what: &str, found: usize| {
            (found == KEYPOINTS).then_some(()).ok_or_else(|| RecordError::Unsuitable {
                what: format!("{what} has {found} entries, expected {KEYPOINTS}"),
            })
        };
        let mut keypoints = None;
        if let Some(rows) = fields.keypoints {
            of_36("keypoints", rows.len())?;
            let isotropic = |row: Option<[f64; 4]>| {
                row.map(|[x, y, score, sd_px]| Keypoint::isotropic(Vector2::new(x, y), score, sd_px))
            };
            let mut set: Box<KeypointSet> = Box::new(std::array::from_fn(|i| isotropic(rows[i])));
            if let Some(covariances) = fields.keypoint_covariances_px2 {
                of_36("keypoint_covariances_px2", covariances.len())?;
                for (point, covariance) in set.iter_mut().zip(covariances) {
                    if let (Some(point), Some([xx, xy, yy])) = (point, covariance) {
                        point.covariance_px2 = Matrix2::new(xx, xy, xy, yy);
                    }
                }
            }
            keypoints = Some(set);
        }
        let CarFields { bbox_px, score, class, held_since, pose_from, seen_after, extra, .. } = fields;
        Ok(Self { bbox_px, score, class, keypoints, held_since, pose_from, seen_after, extra })
    }
}
