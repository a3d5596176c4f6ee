//! The search for start values of the descent, when camera and poses are unknown.

pub(crate) mod alternation;
pub(crate) mod cold_start;
pub(crate) mod on_plane;
pub(crate) mod up_consensus;
pub(crate) mod weak_perspective;
