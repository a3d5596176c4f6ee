//! The search for starts of the descent, without prior knowledge of camera or poses.

pub(crate) mod alternation;
pub(crate) mod cold_start;
pub(crate) mod on_plane;
pub(crate) mod up_consensus;
pub(crate) mod weak_perspective;
