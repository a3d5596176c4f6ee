//! The complete solves: a whole scene (`solve.rs` lists its steps), one car, a given scene, cars with free poses.

mod all_modes;
mod approach;
mod car;
pub(crate) mod fit;
pub(crate) mod free;
mod read_out;
mod reclassify;
pub(crate) mod refine;
mod rejection;
pub(crate) mod solve;
