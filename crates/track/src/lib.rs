//! Cars of single frames, in metres on the ground → smoothed tracks. Pure maths: no I/O, no clock, no random numbers, no
//! panics; the order of the cars in a frame does not matter.
//!
//! # How the pieces join
//! ```text
//! FrameMeasurements → Tracker   tracklets: association beyond doubt, frame by frame         (expected.rs, filter.rs, tracker.rs, raw_track.rs)
//!                   → merge_duplicates      two cars cannot share space                    (duplicates.rs)
//!                   → link                  all continuations of tracklets, chosen jointly (link.rs)
//!                   → find_runs             where the car stood, where it drove            (stops.rs)
//!                   → smooth_track          one pose a stand, a vehicle model between      (way.rs, start.rs, parked.rs, vehicle.rs, chain.rs)
//!                   → facing                which end is the front                         (facing.rs)
//!                   → extend                boxes where a vehicle is expected              (extend.rs, expected.rs)
//!                   → begin                 boxes that drive, or surely stand              (begin.rs)
//!                   → smooth_by_boxes       where only boxes tell: way and size at once    (smooth_boxes.rs, by_boxes.rs, edge.rs)
//!                   → Track                                                              (complete.rs)
//! ```
//!
//! A car that is held ([`HeldCar`]) is seen where it was: it keeps its track alive and its box, and adds nothing to its pose.
//!
//! # Noise
//! A measurement's covariance R is split into a white share, which averages out over frames, and a bias, which a parked car
//! keeps for ever: `R = r R + max(1 − r, β²) R`, r being the scatter that the track really shows (`noise.rs`).

mod begin;
mod box_motion;
mod by_boxes;
mod chain;
mod complete;
mod duplicates;
mod edge;
mod expected;
mod extend;
mod facing;
mod filter;
mod link;
mod looks;
mod measurement;
mod noise;
mod options;
mod parked;
mod raw_track;
mod shape;
mod smooth;
mod smooth_boxes;
mod start;
mod stops;
mod tracker;
mod vehicle;
mod way;

pub use complete::Scene;
pub use looks::Looks;
pub use measurement::{
    BoxSighting, CarMeasurement, ExpectedVehicle, FrameMeasurements, HeldCar, Placed, SURE_SCORE, SeenAgain,
    ShapeBelief, Size, Track, TrackState,
};
pub use options::TrackOptions;
pub use tracker::Tracker;
