//! How good results are: truth files, metrics with their sources, tables with confidence intervals.
//!
//! # Contents
//! ```text
//! commands      dataset, cameras, solver, keypoints, activity, attention, kitti, box_files, run, vehicles, tracker: one `evaluate_…` or
//!               `…_tables` each, called by `roadplane eval …`
//! truth         truth.rs (our own files), readers/ (those of others)
//! estimates     systems/ (the paper's table: which system makes poses of keypoints)
//! comparison    scoring/ (which estimate belongs to which truth), metrics/ (one file each, with its source)
//! presentation  tables/, table.rs, plot.rs, report.rs; intervals: bootstrap.rs
//! ```

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
mod tracker;
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
pub use tracker::{Noise, TrackerOptions, evaluate_tracker};
