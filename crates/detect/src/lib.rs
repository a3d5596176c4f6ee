//! Cars, trucks and buses in a frame.
//!
//! The net (NanoDet, see `models/detector.md`) is fully convolutional, so a frame is looked at in a few passes at
//! different scales instead of many small windows: a fine one for distant cars, a coarse one for near ones. Frames
//! that are too large for one run are cut into overlapping tiles. What the passes find is merged into one list.

mod decode;
mod detector;
mod error;
mod merge;
mod options;
mod resample;
mod tiles;

pub use detector::Detector;
pub use error::DetectError;
pub use options::DetectOptions;
