//! A lane: a ribbon of common paths.

use nalgebra::Vector2;

/// A ribbon of common paths of vehicles in one direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Lane {
    /// Points of the middle in the direction of travel, m. There are at least two.
    pub middle: Vec<Vector2<f64>>,
    /// Sd of each point of the middle across the lane, without the error that all vehicles share, m.
    pub middle_sd_m: Vec<f64>,
    /// Width that 95 % of the vehicles' bodies need, m.
    pub width_m: f64,
    /// Index of the arm from which the lane comes; `None` if no vehicle was seen on the whole path.
    pub from: Option<usize>,
    /// Index of the arm to which the lane leads; `None` if no vehicle was seen on the whole path.
    pub to: Option<usize>,
    /// The vehicles in the lane, sorted by clip and track. A vehicle that changes lanes is in several lanes. If the clips
    /// have more than 2000 vehicles, these are an even sample of them.
    pub stays: Vec<Stay>,
}

/// The time of a vehicle in a lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stay {
    /// Index of the clip.
    pub clip: usize,
    /// Number of the track.
    pub track: u64,
    /// First and last time in the lane, s.
    pub span_s: [f64; 2],
}

/// A place where the first vehicle of queues stops repeatedly.
#[derive(Clone, Debug, PartialEq)]
pub struct StopLine {
    /// Index of the lane; `None` if the vehicles are in no lane.
    pub lane: Option<usize>,
    /// Mean place of the front bumpers in the middle of the lane, m.
    pub place: Vector2<f64>,
    /// Unit vector along the travel.
    pub forward: Vector2<f64>,
    /// Sd of the mean place along the travel, m.
    pub sd_m: f64,
    /// Sd of a single vehicle's place along the travel, m.
    pub spread_m: f64,
    /// Number of queues that began here, on all lanes of this direction.
    pub queues: usize,
}
