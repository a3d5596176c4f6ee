//! One file or folder a command of `roadplane eval`.

pub(crate) mod activity;
pub(crate) mod attention;
pub(crate) mod box_files;
pub(crate) mod cameras;
pub(crate) mod dataset;
pub mod keypoints;
pub(crate) mod kitti;
pub(crate) mod run;
pub mod solver;
pub(crate) mod tracker;
pub(crate) mod vehicles;
