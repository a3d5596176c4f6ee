//! Locates the 36 keypoints of each car with a stacked hourglass net (`models/hourglass.md`).
//!
//! Each keypoint has a score and a covariance.
//!
//! # Contents
//! ```text
//! Schedule       the cars on which the net runs in a frame                      (schedule.rs)
//! → SquareCrop   the part of the picture that the net reads                     (crop.rs)
//! → KeypointNet  crops in batches → heatmaps, visibilities                      (net.rs)
//! → Calibration  heatmap → location with covariance, without the net's prior    (heatmap.rs)
//! ```

mod crop;
mod heatmap;
mod net;
mod schedule;

pub use crop::{CROP_PX, SquareCrop};
pub use heatmap::{Calibration, HeatmapDecoder, Peak};
pub use net::{KeypointError, KeypointNet, KeypointOptions};
pub use schedule::Schedule;
