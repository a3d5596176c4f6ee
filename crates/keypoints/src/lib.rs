//! Locates the 36 keypoints of each car with a stacked hourglass net (`models/hourglass.md`).
//!
//! Each keypoint has a score and a covariance.
//!
//! # Contents
//! ```text
//! schedule.rs  Schedule: chooses the cars on which the net runs in a frame.
//! crop.rs      SquareCrop: the part of the picture that the net reads.
//! net.rs       KeypointNet: turns crops, in batches, into heatmaps and visibilities.
//! heatmap.rs   Calibration: turns a heatmap into a location with covariance, without the net's prior.
//! ```

mod crop;
mod heatmap;
mod net;
mod schedule;

pub use crop::{CROP_PX, SquareCrop};
pub use heatmap::{Calibration, HeatmapDecoder, Peak};
pub use net::{KeypointError, KeypointNet, KeypointOptions};
pub use schedule::Schedule;
