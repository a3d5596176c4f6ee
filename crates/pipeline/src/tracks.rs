//! Locates cars with the estimated camera and tracks them over the clip.

pub(crate) mod chunks;
pub(crate) mod known;
pub(crate) mod pass;
pub(crate) mod poses;
mod rows;
mod scene;
pub(crate) mod shared_error;
pub(crate) mod views;

pub(crate) use chunks::{Load, MOST_ROWS, Numbers, Replay, TimeChunk};
