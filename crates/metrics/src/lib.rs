//! Metrics of detections, tracks, poses and cameras, with the truth files and readers that they need.
//!
//! The crate depends on `base` only, so other programs can use it alone. Each metric is one file that cites its source.
//!
//! # Contents
//! ```text
//! readers/    files of other programs: KITTI, KPF, COCO, MOT Challenge, reference cameras
//! truth/      our own truth files
//! scoring/    which estimate belongs to which true vehicle, and the errors of each pair
//! hota.rs, clear.rs, identity.rs             tracks: HOTA, MOTA, IDF1; sequence.rs holds their input
//! add.rs, viewpoint.rs, reprojection.rs      poses
//! average_precision.rs                       boxes
//! camera.rs, position.rs, motion.rs          cameras, positions, speeds and headings
//! ```

pub mod add;
pub mod average_precision;
pub mod camera;
pub mod clear;
mod error;
pub mod hota;
pub mod identity;
pub mod motion;
pub mod position;
pub mod readers;
pub mod reprojection;
pub mod scoring;
pub mod sequence;
pub mod text_file;
pub mod truth;
pub mod viewpoint;

pub use error::MetricsError;
