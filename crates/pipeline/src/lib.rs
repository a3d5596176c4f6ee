//! Joins the stages: threads and bounded channels for the streaming half, the clip's solve for the other, configuration,
//! cancellation, and what each command of the binary does.
//!
//! # Contents
//! ```text
//! streaming half   streaming.rs over flow.rs (a thread a stage), with watched.rs, scene_lines.rs, stills.rs, samples.rs, speed.rs
//!                  → left.rs: frames.jsonl and what the other half needs
//! solving half     clip.rs: cameras.rs (windows → joint solves → one camera a stretch of time; lens.rs, known.rs, memory.rs)
//!                  → cars.rs, ground_contact.rs, hidden.rs, believe.rs → tracks → finish.rs: files and report (draw.rs, losses.rs)
//! commands         run.rs, piece.rs and join.rs, stage_files.rs, solve_file.rs, track_file.rs, activities.rs, distance.rs, bench.rs,
//!                  doctor.rs
//! around           config.rs, models.rs, identity.rs, limits.rs, progress.rs, cancel.rs, error.rs
//! ```

mod activities;
mod believe;
mod bench;
mod body;
mod cameras;
mod cancel;
mod cars;
mod clip;
mod colours;
mod config;
mod cpu;
mod distance;
mod doctor;
mod draw;
mod error;
mod finish;
mod flow;
mod ground_contact;
mod hidden;
mod identity;
mod join;
mod known;
mod krtd;
mod left;
mod lens;
mod limits;
mod losses;
mod memory;
mod models;
mod moments;
mod pass;
mod piece;
mod progress;
mod run;
mod samples;
mod scene_lines;
mod shared_error;
mod small_picture;
mod solve_file;
mod speed;
mod stage_files;
mod stills;
mod streaming;
mod stretch;
mod track_file;
mod track_rows;
mod watched;

pub use activities::{activity_file, open_activity, track_motion};
pub use bench::{DecodeCost, forget_peak_memory, measure_decoding};
pub use cameras::usable;
pub use cancel::Cancel;
pub use clip::{ClipSolution, solve_clip};
pub use colours::track_colours;
pub use config::{Config, ConfigError};
pub use distance::{Distance, distances};
pub use doctor::{Check, check_up};
pub use draw::render_run;
pub use error::{Fault, PipelineError};
pub use join::{inputs_of, join_pieces};
pub use known::{Known, KnownOptions, Measured};
pub use krtd::{Krtd, read_krtd};
pub use limits::too_small_address_space;
pub use memory::{CameraMemory, KnownCamera, known_cameras, merge_cameras};
pub use models::{find_models, find_runtime};
pub use piece::{PlannedPiece, Span, plan, run_piece, schemas};
pub use progress::{Progress, Silent};
pub use roadplane_write::{EvidenceStore, Existing, FolderLock, WriteError};
pub use run::{RunOptions, RunReport, run_input, stem_of};
pub use scene_lines::SceneView;
pub use solve_file::{SolveOptions, solve_file};
pub use stage_files::{detect_file, keypoints_file};
pub use streaming::{Nets, open_detector, open_input, open_keypoints};
pub use track_file::track_file;
