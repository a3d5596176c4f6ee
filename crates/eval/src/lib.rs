//! How good results are: truth files, metrics with their sources, tables with confidence intervals.
//!
//! # Contents
//! ```text
//! commands/   one file or folder a command of `roadplane eval`: dataset, cameras, solver, keypoints, activity, attention, kitti,
//!             box_files, run (with vehicles), tracker
//! truth/      our own files with the truth;  readers/  those of others
//! systems/    which system makes poses of keypoints (the paper's table)
//! scoring/    which estimate belongs to which truth
//! metrics/    one file each, with its source
//! tables/     scores as tables and plots with intervals (crate `tables`)
//! around      error.rs, finished_run.rs, parallel.rs, text_file.rs, workplace.rs
//! ```

mod commands;
mod error;
mod finished_run;
pub mod metrics;
mod parallel;
pub mod readers;
pub mod scoring;
pub mod systems;
pub mod tables;
mod text_file;
pub mod truth;
mod workplace;

pub use commands::activity::{ActivityOptions, evaluate_activity};
pub use commands::attention::evaluate_attention;
pub use commands::box_files::{evaluate_coco, evaluate_mot};
pub use commands::cameras::evaluate_cameras;
pub use commands::dataset::{DatasetOptions, camera_pictures, dataset_pictures, evaluate_dataset};
pub use commands::kitti::{KittiOptions, evaluate_kitti};
pub use commands::run::evaluate_run;
pub use commands::tracker::{Noise, TrackerOptions, evaluate_tracker};
pub use commands::{keypoints, solver};
pub use error::EvalError;
pub use finished_run::FinishedRun;
