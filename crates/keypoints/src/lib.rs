//! Locates 36 keypoints of each car, each with a score and a covariance, by a stacked hourglass
//! (`models/hourglass.md`).
//!
//! # Contents
//! ```text
//! Schedule       which cars are due                                                 (schedule.rs)
//! → SquareCrop   the part of the picture that the net sees, and the mapping back    (crop.rs)
//! → KeypointNet  crops in batches → heatmaps, visibilities                          (net.rs)
//! → Calibration  heatmap → location with covariance, the net's prior removed        (heatmap.rs)
//! ```

mod crop;
mod heatmap;
mod net;
mod schedule;

pub use crop::{CROP_PX, SquareCrop};
pub use heatmap::{Calibration, HeatmapDecoder, Peak};
pub use net::{KeypointError, KeypointNet, KeypointOptions};
pub use schedule::Schedule;
