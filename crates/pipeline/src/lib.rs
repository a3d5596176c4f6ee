//! Joins the stages to the commands of the program: perception, estimation, output, configuration and cancellation.
//!
//! # Contents
//! Data flows from top to bottom.
//! ```text
//! stream/        perception: input → frames.jsonl (perception.rs). The stages (stages.rs, nets.rs) run on the frames
//!                that cadence.rs chooses, one thread per stage (streaming.rs, flow.rs). Collected on the way:
//!                watched.rs, scene_lines.rs, stills.rs, samples.rs, speed.rs
//! cameras/       frames → the camera at every time (estimate.rs): windows (window.rs), factors of the scene's lines,
//!                user constraints (known.rs), the camera database (memory.rs), the lens (lens.rs), all joined
//!                (joining.rs)
//! tracks/        frames and camera → tracks: poses of cars (cars.rs, ground_contact.rs, hidden.rs), a pass over a time
//!                chunk (pass.rs, scene.rs), validation, rows of tracks (rows.rs), activities (activities.rs)
//! estimation.rs  cameras, then tracks, of a whole clip
//! output/        the solved clip → files (finish.rs, track_rows.rs), report and video (draw.rs, losses.rs)
//! commands/      one file per command
//! others         config.rs, options.rs, models.rs, identity.rs, limits.rs, progress.rs, cancel.rs, error.rs
//! ```

mod cameras;
mod cancel;
mod commands;
mod config;
mod error;
mod estimation;
mod identity;
mod limits;
mod models;
mod options;
mod output;
mod progress;
mod stream;
mod tracks;

pub use cameras::SceneView;
pub use cameras::frame::PLANE_TERMS;
pub use cameras::known::{CameraConstraints, ConstraintOptions, Measured};
pub use cameras::krtd::{Krtd, read_krtd};
pub use cameras::memory::{CameraDatabase, StoredCamera, merge_cameras, stored_cameras};
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
pub use config::{Config, ConfigError};
pub use error::{Fault, PipelineError};
pub use estimation::{ClipSolution, solve_clip};
pub use identity::stem_of;
pub use limits::too_small_address_space;
pub use models::{find_models, find_runtime};
pub use options::{RunOptions, RunReport};
pub use output::draw::render_run;
pub use progress::{Progress, Silent};
pub use roadplane_write::{EvidenceStore, Existing, FolderLock, WriteError};
pub use stream::nets::{Nets, open_activity, open_detector, open_keypoints};
pub use stream::span::Span;
pub use stream::streaming::open_input;
pub use tracks::activities::{activity_file, track_motion};
pub use tracks::usable;
