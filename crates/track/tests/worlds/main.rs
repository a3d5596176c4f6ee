//! Simulated worlds with truth.

#![allow(missing_docs)]

mod driving;
mod honesty;
mod invariance;
mod parked;
mod tangles;
mod world;
