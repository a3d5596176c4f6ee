//! Detects cars, trucks and buses in frames.
//!
//! The net (NanoDet, see `models/detector.md`) is fully convolutional. So it sees a picture in a few passes at
//! different scales instead of many small windows: a fine pass for distant cars, a coarse one for near cars. Pictures
//! that are too large for one run are cut into overlapping tiles. The boxes of all passes are merged into one list.
//!
//! In a clip the net need not run everywhere in every frame: [`RoiScheduler`] chooses the regions of interest.
//!
//! # Contents
//! ```text
//! Observation (watch) → RoiScheduler   changes, vehicles in motion, periodic full scan
//!                                      (regions_of_interest.rs, tracked_box.rs, frame_detections.rs)
//!                     → regions        parts of the picture that are worth a run     (regions.rs)
//!                     → Detector       passes → boxes → one list
//!                                      (detector.rs, resample.rs, decode.rs, merge.rs)
//! ```

mod decode;
mod detector;
mod error;
mod frame_detections;
mod merge;
mod options;
mod regions;
mod regions_of_interest;
mod resample;
mod tiles;
mod tracked_box;

pub use detector::Detector;
pub use error::DetectError;
pub use options::DetectOptions;
pub use regions_of_interest::{RoiDetections, RoiScheduler};
