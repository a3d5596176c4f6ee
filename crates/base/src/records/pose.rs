//! A solved car in a frame: a line of `poses.jsonl`.

use nalgebra::Isometry3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::car::CarRef;
use super::vehicle_class::VehicleClass;
use crate::MODES;

/// The full solve of one car in one frame: a line of `poses.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseRecord {
    /// Index of the frame.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Position of the car in its frame's list.
    pub car: usize,
    /// Track that it belongs to, if any.
    #[serde(default)]
    pub track: Option<u64>,
    /// Box, px.
    pub bbox_px: [f64; 4],
    /// Detector's score.
    pub score: f64,
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// 4 × 4 rigid motion, rows.
    pub world_from_car: [[f64; 4]; 4],
    /// 4 × 4 rigid motion, rows.
    pub camera_from_car: [[f64; 4]; 4],
    /// Shape coefficients, each in units of its sd over all cars.
    pub shape: [f64; MODES],
    /// Length, width, height, m.
    pub dims_m: [f64; 3],
    /// sd of world x, y (m) and heading (rad); infinite ones are null.
    pub pose_sd: [Option<f64>; 3],
    /// Per keypoint x, y, score, sd as measured.
    pub keypoints_px: Vec<Option<[f64; 4]>>,
    /// Root mean square of the used keypoints' residuals, px.
    pub reprojection_rms_px: f64,
    /// Whether the pose is good enough to be tracked.
    pub used: bool,
    /// The pose is held: it is that of this look, whose line has the keypoints.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_from: Option<CarRef>,
}

/// 4 × 4 rows of a rigid motion.
#[must_use]
pub fn rows_from_isometry(motion: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let m = motion.to_homogeneous();
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
}
