//! Metrics of detections, tracks, poses and cameras, and readers of the files that they compare.
//!
//! This crate needs only one other crate of this project, `base`. So other programs can use it alone. Each metric has a
//! file of its own, which cites the source of the metric.
//!
//! # Contents
//! ```text
//! readers/    reads files of other programs: KITTI, KPF, COCO, MOT Challenge, reference cameras
//! truth/      reads the truth files of this project
//! scoring/    pairs estimates with true vehicles, and computes the errors of each pair
//! hota.rs, clear.rs, identity.rs             tracks: HOTA, MOTA, IDF1; their input is in sequence.rs
//! add.rs, viewpoint.rs, reprojection.rs      poses
//! average_precision.rs, detection_curve.rs   boxes
//! camera.rs, position.rs, motion.rs          cameras, positions, speeds and headings
//! ```

pub mod add;
pub mod average_precision;
pub mod camera;
pub mod clear;
pub mod detection_curve;
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
