//! Figures of traffic from tracks on the ground: counts, flows, speeds, headways, zones and queues. Each figure has an
//! interval.
//!
//! The crate is pure: it has no I/O, no clock and no random numbers.
//!
//! # Contents
//! - `vehicle.rs`: the input, vehicles with their paths
//! - `gate.rs`: lines and areas on the ground
//! - `crossing.rs`, `count.rs`: which vehicle crosses a gate, and how many do
//! - `speed.rs`: means and percentiles of speeds
//! - `zone.rs`, `zone_figures.rs`: stays in a zone, occupancy, density, queues
//! - `scene.rs`, `scene/`: arms, lanes and stop lines, found from the paths
//! - `clock.rs`: local time and periods
//! - `site.rs`, `passages.rs`: the clips of a camera, periods, passages over a gate with headways
//! - `figures.rs` (`gate_figures.rs`, `flows.rs`): the figures of a camera; `records.rs`: the tables and their rows
//! - `file.rs`: `traffic.json`
//! - `conflicts.rs`, `conflicts/`: post-encroachment time, time to collision, deceleration to avoid a crash
//! - `normal.rs`: the normal distribution

#![deny(missing_docs)]

mod clock;
mod conflicts;
mod count;
mod crossing;
mod figures;
mod file;
mod flows;
mod gate;
mod gate_figures;
mod lanes;
mod normal;
mod passages;
mod records;
mod scene;
mod site;
mod speed;
mod vehicle;
mod zone;
mod zone_figures;

pub use clock::{Clock, ClockError};
pub use conflicts::{Conflict, ConflictKind, ConflictLimits, Projection, conflicts};
pub use count::count_interval;
pub use crossing::{Crossing, crossings};
pub use file::{TRAFFIC_SCHEMA, TrafficCamera, TrafficClip, TrafficFile, TrafficPlace, Units};
pub use gate::{Direction, Gate, Zone};
pub use normal::SDS_95;
pub use records::{
    ConflictRow, CountRow, CrossingRow, Figures, FlowRow, Group, HeadwayRow, HistogramRow, SpeedRow, ZoneRow,
};
pub use scene::{Arm, Flow, Lane, Scene, Stay, StopLine, find_scene};
pub use site::{Site, SiteClip};
pub use speed::{Measured, Speed, percentile, space_mean, time_mean};
pub use vehicle::{Clip, State, Vehicle};
pub use zone::{Queue, STATIONARY_MPS, Visit, queue, visits};
