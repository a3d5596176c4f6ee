//! The laboratory: evaluates nets, the solver, the tracker and finished runs. Results are tables with confidence
//! intervals.
//!
//! # Contents
//! ```text
//! evaluate/   one file or folder per evaluation: activity, box_files, cameras, dataset, detector, keypoints, kitti,
//!             motion, regions, run (with vehicles), solver, tracker
//! systems/    the systems that estimate poses from keypoints (rows of the tables)
//! tables/     scores as tables and plots with intervals (crate `tables`)
//! others      error.rs, finished_run.rs, parallel.rs, work.rs, workplace.rs
//! args/, commands/, program.rs   the program `roadplane-lab`; its binary is a target of the crate `cli`
//! ```
//! The crate `metrics` holds the metrics and the readers of truth files and of other programs' files.
// Doc comments of arguments are their help texts, in which <name> is not an HTML tag.
#![allow(rustdoc::invalid_html_tags, rustdoc::broken_intra_doc_links)]

mod args;
mod commands;
mod error;
mod evaluate;
mod finished_run;
mod parallel;
mod program;
pub mod systems;
pub mod tables;
mod work;
mod workplace;

pub use error::LabError;
pub use evaluate::activity::{ActivityOptions, evaluate_activity};
pub use evaluate::box_files::{evaluate_coco, evaluate_mot};
pub use evaluate::cameras::evaluate_cameras;
pub use evaluate::dataset::{DatasetOptions, camera_pictures, dataset_pictures, evaluate_dataset};
pub use evaluate::detector::{DetectorOptions, evaluate_detector};
pub use evaluate::kitti::{KittiOptions, evaluate_kitti};
pub use evaluate::motion::{Motion, MotionOptions, evaluate_motion};
pub use evaluate::regions::evaluate_regions;
pub use evaluate::run::evaluate_run;
pub use evaluate::speeds::{MeasuredSpeeds, evaluate_speeds};
pub use evaluate::tracker::{Noise, TrackerOptions, evaluate_tracker};
pub use evaluate::{keypoints, solver};
pub use finished_run::FinishedRun;
pub use program::run_program;
