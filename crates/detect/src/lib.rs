//! Cars, trucks and buses in a frame.
//!
//! The net (NanoDet, see `models/detector.md`) is fully convolutional, so a picture is looked at in a few passes at
//! different scales instead of many small windows: a fine one for distant cars, a coarse one for near ones. Pictures
//! that are too large for one run are cut into overlapping tiles. What the passes find is merged into one list.
//!
//! In a clip it need not look everywhere all the time: [`RoiScheduler`] says where.
//!
//! # Contents
//! ```text
//! Seen (watch) → RoiScheduler   what changed, who does not stand, the sweep      (regions_of_interest.rs, known.rs, frame_detections.rs)
//!              → regions     parts of the picture that are worth a run        (regions.rs)
//!              → Detector    passes → boxes → one list                        (detector.rs, resample.rs, decode.rs, merge.rs)
//! ```

mod decode;
mod detector;
mod error;
mod frame_detections;
mod known;
mod merge;
mod options;
mod regions;
mod regions_of_interest;
mod resample;
mod tiles;

pub use detector::Detector;
pub use error::DetectError;
pub use options::DetectOptions;
pub use regions_of_interest::{Look, RoiScheduler};
