//! Latent variables of a car: its body type and its trust. `kernel.rs` treats whether a keypoint is right.

pub(crate) mod body_types;
pub(crate) mod trust;
