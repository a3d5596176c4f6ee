//! What nobody tells: of what body type a car is, and how far it can be trusted. (Whether a keypoint is right: `kernel.rs`.)

pub(crate) mod body_types;
pub(crate) mod trust;
