//! Metrics, one file each: pure functions that cite their source.

pub mod add;
pub mod average_precision;
pub mod camera;
pub mod clear;
pub mod hota;
pub mod identity;
pub mod motion;
pub mod position;
pub mod reprojection;
pub mod sequence;
pub mod viewpoint;
