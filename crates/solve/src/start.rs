//! From nothing to places where a descent may begin.

pub(crate) mod alternation;
pub(crate) mod cold_start;
pub(crate) mod standing;
pub(crate) mod up_consensus;
pub(crate) mod weak_perspective;
