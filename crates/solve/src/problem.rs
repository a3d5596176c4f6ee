//! Problems for the descent: cars on a common plane, and cars whose poses are free.

pub(crate) mod free;
pub(crate) mod ground;
pub(crate) mod setup;
