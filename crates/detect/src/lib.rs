//! Detects cars, trucks, buses and motorcycles in frames.
//!
//! The net (NanoDet, see `models/detector.md`) is fully convolutional. It therefore processes a picture in a few passes
//! at different scales instead of in many small windows. A fine pass finds distant cars, and a coarse pass finds near
//! cars. A picture that is too large for one run is cut into overlapping tiles. The boxes of all passes are merged into
//! one list.
//!
//! In a clip, the net does not run on the whole picture of every frame. [`RoiScheduler`] chooses the regions of
//! interest.
//!
//! # Contents
//! ```text
//! Observation (watch) → RoiScheduler   chooses areas: changes, moving vehicles, a periodic full scan
//!                                      (regions_of_interest.rs, tracked_box.rs, frame_detections.rs)
//!                     → FineRows       rows in which the fine pass runs   (fine_rows.rs)
//!                     → regions        parts of the picture that cover these areas   (regions.rs)
//!                     → Detector       runs the net in the passes   (detector.rs, resample.rs, decode.rs)
//!                     → FrameDetections  merges the boxes   (frame_detections.rs, merge.rs)
//!                     → measure_colours  the mean colour of each box   (colour.rs)
//! ```

mod colour;
mod decode;
mod detector;
mod error;
mod fine_rows;
mod frame_detections;
mod merge;
mod options;
mod regions;
mod regions_of_interest;
mod resample;
mod tiles;
mod tracked_box;

pub use colour::measure_colours;
pub use detector::Detector;
pub use error::DetectError;
pub use options::DetectOptions;
pub use regions_of_interest::{RoiDetections, RoiScheduler};
