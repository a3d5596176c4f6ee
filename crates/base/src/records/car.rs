//! A detected vehicle in a frame: an entry of `cars` in a frames file.

use nalgebra::{Matrix2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::error::RecordError;
use super::vehicle_class::VehicleClass;
use crate::{KEYPOINTS, Keypoint, KeypointSet, bbox_longer_side};

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
    /// Mean colour of the middle of its box: red, green, blue. `None` where nearer vehicles hide it.
    pub colour_rgb: Option<[u8; 3]>,
    /// Keypoints. They are absent before the keypoint stage, and if the pose is carried over from an earlier frame.
    pub keypoints: Option<Box<KeypointSet>>,
    /// Index of the earlier frame from which the box is carried over. The picture at the box has not changed since that
    /// frame. `None` if the detector found the box in this frame.
    pub held_since: Option<u64>,
    /// Earlier observation of the car, from which the pose is carried over. The car has not moved since that
    /// observation.
    pub pose_from: Option<CarRef>,
    /// An earlier observation of the same car, with keypoints. It is so recent that new keypoints would add no
    /// information.
    pub seen_after: Option<CarRef>,
    /// Fields that other tools added. They are written back unchanged.
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
    /// Mean colour of the middle of its box: red, green, blue. Absent where nearer vehicles hide it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour_rgb: Option<[u8; 3]>,
}

/// A reference to a vehicle in a frame. Files store it as `[frame, car]`: the index of the frame, and the index in the
/// frame's list `cars`, both from 0.
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
    /// Whether its box or its pose is carried over from an earlier frame.
    #[must_use]
    pub fn is_carried_over(&self) -> bool {
        self.held_since.is_some() || self.pose_from.is_some()
    }

    /// Creates a car with a box and without keypoints.
    #[must_use]
    pub fn boxed(bbox_px: [f64; 4]) -> Self {
        Self {
            bbox_px,
            score: 1.0,
            class: VehicleClass::Car,
            colour_rgb: None,
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
        bbox_longer_side(&self.bbox_px)
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
    /// Mean colour of the middle of its box: red, green, blue. Absent where nearer vehicles hide it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    colour_rgb: Option<[u8; 3]>,
    /// The 36 keypoints, each `[x, y, score, sd]`: x, y and sd in px, score from 0 to 1. A keypoint without a
    /// measurement is null. The sd is the same in all directions, unless `keypoint_covariances_px2` has an entry for
    /// the keypoint. The list is absent before the keypoint stage, and if the pose is carried over from an earlier
    /// frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    keypoints: Option<Vec<Option<[f64; 4]>>>,
    /// Covariances `[xx, xy, yy]` of the 36 keypoints, px². The list is present if the sd of a keypoint is not the same
    /// in all directions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    keypoint_covariances_px2: Option<Vec<Option<[f64; 3]>>>,
    /// Index of the earlier frame from which the box is carried over. The picture at the box has not changed since that
    /// frame. Absent if the detector found the box in this frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    held_since: Option<u64>,
    /// Reference `[frame, car]` to the earlier observation from which the pose is carried over. The two numbers are the
    /// index of a frame and the index in that frame's `cars`. The vehicle has not moved since that frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pose_from: Option<CarRef>,
    /// Reference `[frame, car]` to an earlier observation that has keypoints. The observation is so recent that new
    /// keypoints would add no information. Therefore the keypoint net skipped the vehicle in this frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seen_after: Option<CarRef>,
    #[serde(flatten)]
    extra: Map<String, Value>,
}

/// Rounds a number in px or px² to 0.0001, as in files. This step is far below any keypoint's sd.
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
            colour_rgb: car.colour_rgb,
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
        let CarFields { bbox_px, score, class, colour_rgb, held_since, pose_from, seen_after, extra, .. } =
            fields;
        Ok(Self { bbox_px, score, class, colour_rgb, keypoints, held_since, pose_from, seen_after, extra })
    }
}
