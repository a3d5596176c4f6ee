//! Tests of the crate on simulated records with known truth.

#![allow(missing_docs, clippy::unwrap_used, clippy::panic)]

mod combining;
mod epochs;
mod fusing;
mod linking;
mod moving_camera;
mod places;
mod records;
mod selecting;
mod verticals;
