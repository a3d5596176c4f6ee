//! Figures of traffic from tracks on the ground: counts, flows, speeds, headways, zones, queues and conflicts. Each
//! figure has an interval.
//!
//! The crate is pure: it has no I/O, no clock and no random numbers.
//!
//! # Contents
//! - `vehicle.rs`: the input, vehicles with their paths
//! - `gate.rs`: lines and areas on the ground

#![deny(missing_docs)]

mod gate;
mod vehicle;

pub use gate::{Direction, Gate, Zone};
pub use vehicle::{Clip, State, Vehicle};
