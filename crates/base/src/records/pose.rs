//! The estimated pose of a car in a frame: a line of `poses.jsonl`.

use nalgebra::Isometry3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::car::CarRef;
use super::vehicle_class::VehicleClass;
use crate::MODES;

/// The 6-DoF pose, shape and keypoints of one vehicle in one frame: a line of `poses.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "poses: one line per vehicle and frame")]
pub struct PoseRecord {
    /// Index of the frame in its input, from 0.
    pub frame: u64,
    /// Presentation time of the frame, s.
    pub time_s: f64,
    /// Index of the vehicle in its frame's list of vehicles, from 0.
    pub car: usize,
    /// Number of the track that the vehicle belongs to, from 1; null if the vehicle belongs to no track.
    #[serde(default)]
    #[schemars(range(min = 1))]
    pub track: Option<u64>,
    /// Box of the vehicle in the picture: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Score of the detector, 0 to 1.
    #[schemars(range(min = 0, max = 1))]
    pub score: f64,
    /// Class of the vehicle.
    pub class: VehicleClass,
    /// Rigid motion from car to world coordinates: the rows of a 4 × 4 matrix, translation in m.
    pub world_from_car: [[f64; 4]; 4],
    /// Rigid motion from car to camera coordinates: the rows of a 4 × 4 matrix, translation in m.
    pub camera_from_car: [[f64; 4]; 4],
    /// Coefficients of the shape atlas, each in units of its sd over all cars.
    pub shape: [f64; MODES],
    /// Length, width without mirrors, and height of the vehicle, m.
    pub dims_m: [f64; 3],
    /// Sds of world x (m), world y (m) and heading (rad). An infinite sd is null.
    pub pose_sd: [Option<f64>; 3],
    /// The 36 measured keypoints, each `[x, y, score, sd]`: x, y and sd in px, score from 0 to 1. A keypoint without a
    /// measurement is null. All are null if the pose is carried over from an earlier frame.
    pub keypoints_px: Vec<Option<[f64; 4]>>,
    /// Root mean square of the residuals of the used keypoints, px.
    #[schemars(range(min = 0))]
    pub reprojection_rms_px: f64,
    /// Whether the tracker uses the pose. If false, the pose fits the keypoints too poorly.
    pub used: bool,
    /// Reference `[frame, car]` to the earlier observation from which the pose is carried over. The line of that
    /// observation contains the keypoints. Absent if the pose was measured in this frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_from: Option<CarRef>,
}

/// Returns the rows of a rigid motion's 4 × 4 matrix.
#[must_use]
pub fn rows_from_isometry(motion: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let m = motion.to_homogeneous();
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
}
