//! The laboratory: evaluations of nets, solver, tracker and finished runs, as tables with confidence intervals.
//!
//! # Contents
//! ```text
//! evaluate/   one file or folder per evaluation: dataset, cameras, solver, keypoints, activity, attention, kitti, box_files,
//!             run (with vehicles), tracker
//! systems/    the systems that estimate poses from keypoints (the paper's table)
//! tables/     scores as tables and plots with intervals (crate `tables`)
//! others      error.rs, finished_run.rs, parallel.rs, workplace.rs
//! args/, commands/, main.rs   the binary `roadplane-lab`
//! ```
//! Metrics, truth files and readers are in the crate `metrics`.

mod error;
mod evaluate;
mod finished_run;
mod parallel;
pub mod systems;
pub mod tables;
mod workplace;

pub use error::LabError;
pub use evaluate::activity::{ActivityOptions, evaluate_activity};
pub use evaluate::attention::evaluate_attention;
pub use evaluate::box_files::{evaluate_coco, evaluate_mot};
pub use evaluate::cameras::evaluate_cameras;
pub use evaluate::dataset::{DatasetOptions, camera_pictures, dataset_pictures, evaluate_dataset};
pub use evaluate::kitti::{KittiOptions, evaluate_kitti};
pub use evaluate::run::evaluate_run;
pub use evaluate::tracker::{Noise, TrackerOptions, evaluate_tracker};
pub use evaluate::{keypoints, solver};
pub use finished_run::FinishedRun;
