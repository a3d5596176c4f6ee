//! What a tracker can be told.

use serde::{Deserialize, Serialize};

/// How cars are taken to move, appear and disappear.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackOptions {
    /// Score that a car needs to start a track.
    pub birth_score: f64,
    /// A new track must be seen in so many …
    pub confirm_hits: usize,
    /// … of its first so many frames.
    pub confirm_frames: usize,
    /// Tracks seen in fewer frames are dropped (or in half of the frames of a clip shorter than twice that).
    pub min_observed: usize,
    /// Share of the frames of its life in which a track must be seen, unless its box stays where it was.
    pub min_duty: f64,
    /// A driving car that was not seen for so long is only found again by what all tracks make of it together, s.
    pub max_coast_s: f64,
    /// A parked one, s.
    pub max_parked_coast_s: f64,
    /// A car may be hidden for so long, s.
    pub max_hidden_s: f64,
    /// Squared Mahalanobis distance (x, y, heading) of a measurement that may still be the track's.
    pub gate: f64,
    /// Least sd of a measured position, m: nobody measures better.
    pub min_position_sd_m: f64,
    /// Least sd of a measured heading, rad.
    pub min_heading_sd_rad: f64,
    /// Share of a measurement's sd that is at least taken for bias, which does not average out over frames.
    pub bias_share: f64,
    /// Motion over about a second that tells a driving car from a parked one, m.
    pub min_motion_m: f64,
    /// Change of speed within 1 s (1 sd; grows with the root of time), m/s.
    pub speed_change: f64,
    /// Change of the path's curvature within 1 s, 1/m.
    pub curvature_change: f64,
    /// Typical curvature of a path, 1/m.
    pub curvature_sd: f64,
    /// Sideways slip within 1 s, m.
    pub slip_m: f64,
    /// Rear axle to the car's origin, m.
    pub half_wheelbase_m: f64,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            birth_score: 0.0,
            confirm_hits: 3,
            confirm_frames: 5,
            min_observed: 6,
            min_duty: 0.4,
            max_coast_s: 0.4,
            max_parked_coast_s: 60.0,
            max_hidden_s: 60.0,
            gate: 20.0,
            min_position_sd_m: 0.02,
            min_heading_sd_rad: 0.005,
            bias_share: 0.6,
            min_motion_m: 0.4,
            speed_change: 1.0,
            curvature_change: 0.1,
            curvature_sd: 0.15,
            slip_m: 0.05,
            half_wheelbase_m: 1.35,
        }
    }
}
