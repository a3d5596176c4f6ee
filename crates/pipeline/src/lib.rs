//! Joins the stages: threads and bounded channels for the streaming half, the clip's solve for the other, configuration,
//! cancellation, and what each command of the binary does.

mod activities;
mod believe;
mod bench;
mod cameras;
mod cancel;
mod cars;
mod clip;
mod config;
mod cpu;
mod doctor;
mod draw;
mod error;
mod flow;
mod identity;
mod models;
mod progress;
mod run;
mod samples;
mod solve_file;
mod speed;
mod stage_files;
mod streaming;
mod watched;

pub use activities::{activity_file, open_activity, track_motion};
pub use bench::{DecodeCost, forget_peak_memory, measure_decoding};
pub use cancel::Cancel;
pub use clip::{ClipSolution, solve_clip};
pub use config::{Config, ConfigError};
pub use doctor::{Check, check_up};
pub use draw::render_run;
pub use error::{Fault, PipelineError};
pub use models::find_models;
pub use progress::{Progress, Silent};
pub use roadplane_write::{Existing, FolderLock};
pub use run::{RunOptions, RunReport, run_input, stem_of};
pub use solve_file::{SolveOptions, solve_file};
pub use stage_files::{detect_file, keypoints_file};
pub use streaming::{Nets, open_detector, open_input, open_keypoints};
