//! The settings of a tracker.

use serde::{Deserialize, Serialize};

use crate::TrackSteps;

/// Settings that describe how cars move, appear and disappear.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackOptions {
    /// Number of detections that confirm a new track, within its first `confirm_frames` inference frames.
    pub confirm_hits: usize,
    /// Number of inference frames within which a new track must be confirmed by `confirm_hits` detections.
    pub confirm_frames: usize,
    /// Least number of detections of a track. If half of the clip's inference frames are fewer, that half is enough.
    pub min_observed: usize,
    /// Least probability that a track is a vehicle, 0–1. Other tracks are dropped.
    pub min_exists_p: f64,
    /// Longest time for which a driving car is followed without a detection, s. After a longer gap only the joint
    /// linking of tracklets (`link.rs`) can find it again.
    pub max_coast_s: f64,
    /// Longest time for which a parked car is followed without a detection, s.
    pub max_parked_coast_s: f64,
    /// Longest time for which a car may be hidden, s. Linking bridges no longer gaps.
    pub max_hidden_s: f64,
    /// Squared Mahalanobis distance of (x, y, heading) up to which a measurement may belong to a track, without unit.
    pub gate: f64,
    /// Least sd of a measured position, m: no measurement is better than this.
    pub min_position_sd_m: f64,
    /// Least sd of a measured heading, rad: no measurement is better than this.
    pub min_heading_sd_rad: f64,
    /// Least motion over about one second that distinguishes a driving car from a parked one, m.
    pub min_motion_m: f64,
    /// Sd of the change of speed within 1 s, m/s. It grows with the square root of time.
    pub speed_change: f64,
    /// Sd of the change of the path's curvature within 1 s, 1/m. It grows with the square root of time.
    pub curvature_change: f64,
    /// Typical curvature (sd) of a path, 1/m.
    pub curvature_sd: f64,
    /// Sd of the sideways slip within 1 s, m. It grows with the square root of time.
    pub slip_m: f64,
    /// Distance from the rear axle to the car's origin, m.
    pub half_wheelbase_m: f64,
    /// Steps that are switched on. They are no settings: only the laboratory switches steps off.
    #[serde(skip)]
    pub steps: TrackSteps,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            confirm_hits: 3,
            confirm_frames: 5,
            min_observed: 6,
            min_exists_p: 0.5,
            max_coast_s: 0.4,
            max_parked_coast_s: 60.0,
            max_hidden_s: 60.0,
            gate: 20.0,
            min_position_sd_m: 0.02,
            min_heading_sd_rad: 0.005,
            min_motion_m: 0.4,
            speed_change: 1.0,
            curvature_change: 0.1,
            curvature_sd: 0.15,
            slip_m: 0.05,
            half_wheelbase_m: 1.35,
            steps: TrackSteps::default(),
        }
    }
}
