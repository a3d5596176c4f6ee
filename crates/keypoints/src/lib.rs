//! Frame + boxes → 36 keypoints a car, each with score and covariance, by a stacked hourglass (`models/hourglass.md`).
//!
//! # Contents
//! ```text
//! Schedule       which cars are due                                              (schedule.rs)
//! → SquareCrop   the part of the picture that the net sees, and the way back     (crop.rs)
//! → KeypointNet  crops in batches → heatmaps, visibilities                       (net.rs)
//! → Calibration  heatmap → place with covariance, the net's prior taken out      (heatmap.rs)
//! ```

mod crop;
mod heatmap;
mod net;
mod schedule;

pub use crop::{CROP_PX, SquareCrop};
pub use heatmap::{Calibration, HeatmapDecoder, Peak};
pub use net::{KeypointError, KeypointNet, KeypointOptions};
pub use schedule::Schedule;
