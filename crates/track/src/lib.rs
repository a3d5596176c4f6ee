//! Turns the cars of single frames, in metres on the ground, into smoothed tracks.
//!
//! The crate is pure mathematics: it has no I/O, no system clock, no random numbers and no panics. The order of the
//! cars in a frame does not matter.
//!
//! # Stages
//! ```text
//! FrameRecord
//!   → Clock             when each picture was taken                           (clock.rs, delays.rs)
//! FrameMeasurements
//!   → Tracker           tracklets: certain associations only, frame by frame  (expected.rs, filter.rs, tracker.rs,
//!                                                                              raw_track.rs)
//!   → merge_duplicates  two cars cannot share space                           (duplicates.rs)
//!   → add_boxes         tracklets of all other boxes, weak and strong         (picture_chains.rs, placed_boxes.rs)
//!   → link              all continuations, and which boxes belong to none     (continuation.rs, link.rs, join.rs,
//!                                                                              parts.rs)
//!   → find_runs         stationary intervals and driving intervals            (stops.rs)
//!   → smooth_track      heading disambiguation: which end is the front; one   (path.rs, path_parts.rs, start.rs,
//!                       pose per stationary interval, else a vehicle model     parked.rs, vehicle.rs, chain.rs,
//!                                                                              descent.rs)
//!   → Evidence          is the track a vehicle?                               (existence.rs)
//!   → smooth_by_boxes   path and size together, where only boxes show them    (smooth_boxes.rs, by_boxes.rs)
//!   → add_detections    boxes in frames in which nothing measures the pose    (tracker.rs)
//!   → Track                                                                   (complete.rs)
//! ```
//!
//! A [`CarriedCar`] has not moved since an earlier inference frame, so it counts as detected at its earlier position. It
//! keeps its track and its box alive, and adds nothing to its pose.
//!
//! # Noise
//! The covariance R of a measurement assumes independent errors of the keypoints. The true covariance is c² R, with c =
//! [`roadplane_measure::POSE_SD_RATIO`]. It is split into two parts, `r R + max(c² − r, 1) g R` (`noise.rs`). The first
//! part is white and averages out over frames. The second part is a bias, which never averages out for a parked car.
//! Here r is the scatter that the track shows relative to R. The factor g is 1 or more; it grows where the keypoints of a
//! frame do not fit a car.

mod box_motion;
mod by_boxes;
mod chain;
mod clock;
mod colour;
mod complete;
mod continuation;
mod delays;
mod descent;
mod duplicates;
mod existence;
mod expected;
mod filter;
mod frames;
mod join;
mod link;
mod measurement;
mod noise;
mod numbers;
mod options;
mod parked;
mod parts;
mod path;
mod path_parts;
mod picture_chains;
mod placed_boxes;
mod raw_track;
mod scene;
mod shape;
mod smooth_boxes;
mod start;
mod stops;
mod tracker;
mod vehicle;

pub use clock::{Clock, ClockReader};
pub use complete::Tracks;
pub use existence::Evidence;
pub use join::Join;
pub use measurement::{
    CarMeasurement, CarriedCar, Detection, FrameMeasurements, SeenAgain, ShapeEstimate, Track, TrackState,
};
pub use numbers::{FEATURES, JOIN_FEATURES};
pub use options::{TrackOptions, TrackStep};
pub use scene::Scene;
pub use tracker::Tracker;
