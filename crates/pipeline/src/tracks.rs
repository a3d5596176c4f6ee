//! Locates cars with the estimated camera and tracks them over the clip.

pub(crate) mod activities;
pub(crate) mod believe;
pub(crate) mod body;
pub(crate) mod cars;
pub(crate) mod ground_contact;
pub(crate) mod hidden;
pub(crate) mod known;
pub(crate) mod pass;
mod rows;
mod scene;
pub(crate) mod shared_error;
pub(crate) mod stretch;
pub(crate) mod views;

pub use believe::usable;
pub(crate) use stretch::{Load, MOST_ROWS, Numbers, Replay, TimeChunk, detections_of};
