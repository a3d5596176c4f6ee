//! The evaluations: one file or folder for each command of `roadplane-lab eval`.

pub(crate) mod activity;
pub(crate) mod box_files;
pub(crate) mod cameras;
pub(crate) mod dataset;
pub(crate) mod detector;
pub mod keypoints;
pub(crate) mod kitti;
pub(crate) mod motion;
pub(crate) mod regions;
pub(crate) mod run;
pub mod solver;
pub(crate) mod speeds;
pub(crate) mod tracker;
pub(crate) mod vehicles;
