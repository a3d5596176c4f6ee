//! The problem for the descent: cars on a common plane, or with free poses; and what a frame's input is made into.

pub(crate) mod cars;
pub(crate) mod setup;
