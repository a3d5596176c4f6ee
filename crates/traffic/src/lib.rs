//! Figures of traffic from tracks on the ground: counts, flows, speeds, headways, zones, queues and conflicts. Each
//! figure has an interval.
//!
//! The crate is pure: it has no I/O, no clock and no random numbers.
//!
//! # Contents
//! - `vehicle.rs`: the input, vehicles with their paths
//! - `gate.rs`: lines and areas on the ground
//! - `scene.rs`: arms, lanes, stop lines and flows, found from the paths of vehicles

#![deny(missing_docs)]

mod gate;
mod scene;
mod vehicle;

pub use gate::{Direction, Gate, Zone};
pub use scene::{Arm, Flow, Lane, Scene, Stay, StopLine, find_scene};
pub use vehicle::{Clip, State, Vehicle};
