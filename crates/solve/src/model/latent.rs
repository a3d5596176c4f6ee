//! Latent variables of a car: its body type, and its weight in the camera's equations (the trust).

pub(crate) mod body_types;
pub(crate) mod trust;
