//! The measurement model: projection of a car's keypoints into the image, keypoint errors, and priors.

pub(crate) mod camera_prior;
#[cfg(test)]
mod derivatives;
pub(crate) mod free;
pub(crate) mod kernel;
pub(crate) mod latent;
pub(crate) mod observation;
pub(crate) mod on_plane;
pub(crate) mod pack;
pub(crate) mod points;
pub(crate) mod pose;
pub(crate) mod rows;
