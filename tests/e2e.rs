//! End-to-end tests: `roadplane` on real and rendered input, and on bad input.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod bad_inputs;
mod cameras;
mod common;
mod demo_clip;
mod export;
mod golden_chain;
mod messages;
mod pieces;
mod real_clips;
mod reliability;
mod scene_lines;
