//! The least-squares problem of a frame's cars, on a common plane or with free poses, and the preparation of its input.

pub(crate) mod cars;
pub(crate) mod setup;
