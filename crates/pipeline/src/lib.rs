//! Implements the commands of the program. A command runs perception, then estimation, then writes the output.
//! Configuration and cancellation are here too.
//!
//! # Contents
//! The data of a run passes through these modules from top to bottom.
//! ```text
//! stream/        perception: reads an input and writes frames.jsonl (perception.rs). The stages (stages.rs, nets.rs)
//!                run on the frames that cadence.rs chooses, each in its own thread (streaming.rs, flow.rs).
//!                watched.rs, scene_lines.rs, stills.rs, samples.rs and speed.rs collect further data from the frames
//! cameras/       estimates the camera over time from the frames (estimate.rs), in time windows (window.rs). Further
//!                inputs are lines of the scene, user constraints (known.rs), the camera database (database.rs) and the
//!                lens (lens.rs). joining.rs has the options for joining windows and clips
//! tracks/        estimates tracks from the frames and the camera: one pass over a time chunk (pass.rs, scene.rs), lines
//!                of poses.jsonl (poses.rs), rows of tracks (rows.rs)
//! activities.rs  finds activities in the tracks
//! estimation.rs  runs cameras/ and then tracks/ for a whole clip
//! output/        writes the files of a result (finish.rs, track_rows.rs), its report and its video (draw.rs,
//!                losses.rs)
//! traffic/       tables of traffic from the tracks of finished runs
//! commands/      one file per command
//! other files    config.rs, options.rs, models.rs, inputs.rs, identity.rs, recorded.rs, limits.rs,
//!                progress.rs, cancel.rs, error.rs
//! ```

mod activities;
mod cameras;
mod cancel;
mod commands;
mod config;
mod error;
mod estimation;
mod identity;
mod inputs;
mod limits;
mod models;
mod not_followed;
mod options;
mod output;
mod progress;
mod recorded;
mod stream;
mod tracks;
mod traffic;

pub use activities::{activity_file, track_motion};
pub use cameras::database::{CameraDatabase, StoredCamera, merge_cameras, stored_cameras};
pub use cameras::frame::PLANE_TERMS;
pub use cameras::known::{CameraConstraints, ConstraintOptions, Measured};
pub use cameras::krtd::{Krtd, read_krtd};
pub use cancel::Cancel;
pub use commands::bench::{DecodeCost, forget_peak_memory, measure_decoding};
pub use commands::colours::track_colours;
pub use commands::distance::{Distance, distances};
pub use commands::doctor::{Check, check_up};
pub use commands::join::{inputs_of, join_pieces};
pub use commands::piece::{PlannedPiece, plan, run_piece, schemas};
pub use commands::run::run_input;
pub use commands::solve_file::{SolveMethod, SolveOptions, solve_file};
pub use commands::stage_files::{detect_file, keypoints_file};
pub use commands::track_file::track_file;
pub use config::{Config, ConfigError, TrafficConfig};
pub use error::{Fault, PipelineError};
pub use estimation::{ClipSolution, solve_clip};
pub use identity::stem_of;
pub use inputs::clips_of;
pub use limits::too_small_address_space;
pub use models::{find_models, find_runtime};
pub use options::{RunOptions, RunReport};
pub use output::draw::render_run;
pub use progress::{Progress, Silent};
pub use recorded::{Recorded, RecordedFrom, recorded};
pub use roadplane_traffic::Units;
pub use roadplane_write::{EvidenceStore, Existing, FolderLock, WriteError};
pub use stream::nets::{Nets, open_activity, open_detector, open_keypoints};
pub use stream::span::Span;
pub use stream::streaming::open_input;
pub use traffic::{
    TrafficOptions, TrafficReport, check_traffic, traffic, write_traffic, write_traffic_pictures,
};
