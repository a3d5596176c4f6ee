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

mod bootstrap;
mod commands;
mod error;
pub mod metrics;
mod parallel;
mod plot;
pub mod readers;
mod report;
pub mod scoring;
pub mod systems;
mod table;
pub mod tables;
mod text_file;
pub mod truth;
mod workplace;

pub use bootstrap::{Estimate, bootstrap, bootstrap_scenes, mean, median, quantile, share_within};
pub use commands::activity::{ActivityOptions, evaluate_activity};
pub use commands::attention::evaluate_attention;
pub use commands::box_files::{evaluate_coco, evaluate_mot};
pub use commands::cameras::evaluate_cameras;
pub use commands::dataset::{DatasetOptions, camera_pictures, dataset_pictures, evaluate_dataset};
pub use commands::kitti::{KittiOptions, evaluate_kitti};
pub use commands::run::{FinishedRun, evaluate_run};
pub use commands::tracker::{Noise, TrackerOptions, evaluate_tracker};
pub use commands::{keypoints, solver};
pub use error::EvalError;
pub use plot::{Mark, Plot, Series};
pub use report::{Picture, Report};
pub use table::{Cell, Column, Table};
