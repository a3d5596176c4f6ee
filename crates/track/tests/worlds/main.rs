//! Tests of the tracker in simulated worlds, where the truth is available.

#![allow(missing_docs, clippy::unwrap_used, clippy::panic)]

mod boxes;
mod driving;
mod invariance;
mod junction;
mod parked;
mod tangles;
mod uncertainty;
mod weak;
mod world;
