//! Frame + boxes → 36 keypoints a car, each with score and covariance, by a stacked hourglass (`models/hourglass.md`).

mod crop;
mod heatmap;
mod net;
mod schedule;

pub use crop::{CROP_PX, SquareCrop};
pub use heatmap::{Calibration, HeatmapDecoder, Peak};
pub use net::{KeypointError, KeypointNet, KeypointOptions};
pub use schedule::Schedule;
