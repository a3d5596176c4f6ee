//! How good results are: truth files, metrics with their sources, tables with confidence intervals.

mod activity;
mod attention;
mod bootstrap;
mod box_files;
mod cameras;
mod dataset;
mod error;
pub mod keypoints;
mod kitti;
pub mod metrics;
mod parallel;
mod plot;
pub mod readers;
mod report;
mod run;
pub mod scoring;
pub mod solver;
pub mod systems;
mod table;
pub mod tables;
mod text_file;
pub mod truth;
mod vehicles;
mod workplace;

pub use activity::{ActivityOptions, evaluate_activity};
pub use attention::evaluate_attention;
pub use bootstrap::{Estimate, bootstrap, bootstrap_scenes, mean, median, quantile, share_within};
pub use box_files::{evaluate_coco, evaluate_mot};
pub use cameras::evaluate_cameras;
pub use dataset::{DatasetOptions, camera_pictures, dataset_pictures, evaluate_dataset};
pub use error::EvalError;
pub use kitti::{KittiOptions, evaluate_kitti};
pub use plot::{Mark, Plot, Series};
pub use report::{Picture, Report};
pub use run::{FinishedRun, evaluate_run};
pub use table::{Cell, Column, Table};
