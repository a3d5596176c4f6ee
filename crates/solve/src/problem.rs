//! The problem for the descent, with cars on a common plane or with free poses; and the preparation of a frame's input.

pub(crate) mod cars;
pub(crate) mod setup;
