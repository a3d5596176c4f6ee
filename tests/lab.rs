//! End-to-end tests of the program `roadplane-lab`, on given, rendered and generated data.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod bench;
mod common;
mod dataset;
mod eval;
mod synth;
