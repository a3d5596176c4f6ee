//! End-to-end tests of the program `roadplane`, on real input, rendered input and bad input.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod bad_inputs;
mod cameras;
mod common;
mod demo_clip;
mod export;
mod golden_chain;
mod messages;
mod moving_camera;
mod pieces;
mod real_clips;
mod reliability;
mod scene_lines;
mod terminal;
mod traffic;
