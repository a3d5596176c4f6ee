//! Joins the stages: threads and bounded channels for the streaming half, the clip's solve for the other, configuration,
//! cancellation, and what each command of the binary does.
//!
//! # Contents
//! Data flows from top to bottom.
//! ```text
//! stream/     pictures → frames.jsonl: nets.rs, stages.rs in the order of cadence.rs, streaming.rs over flow.rs (a thread a stage);
//!             with watched.rs, scene_lines.rs, stills.rs, samples.rs, speed.rs; left.rs writes all that is needed further on
//! cameras/    frames → the camera at every time (estimate.rs): windows solved (window.rs), lines of the scene (witnesses.rs), what
//!             is known.rs and remembered (memory.rs, remembered.rs), the lens.rs, all joined (joining.rs)
//! tracks/     frames and camera → tracks: each car (cars.rs, ground_contact.rs, hidden.rs), what is believed (believe.rs), a pass
//!             over a stretch (pass.rs, known.rs, scene.rs, stretch.rs), rows.rs, what tracks do (activities.rs)
//! clip.rs     cameras, then tracks, of a whole clip
//! output/     the solved clip → files (finish.rs, track_rows.rs), report and video (draw.rs, losses.rs)
//! commands/   run.rs, piece.rs and join.rs, stage_files.rs, solve_file.rs, track_file.rs, colours.rs, distance.rs, bench.rs, doctor.rs
//! around      config.rs, options.rs, models.rs, identity.rs, limits.rs, progress.rs, cancel.rs, error.rs
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

pub use cameras::frame::PLANE_TERMS;
pub use cameras::known::{CameraConstraints, ConstraintOptions, Measured};
pub use cameras::krtd::{Krtd, read_krtd};
pub use cameras::memory::{CameraDatabase, StoredCamera, merge_cameras, stored_cameras};
pub use cameras::witnesses::SceneView;
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
pub use tracks::believe::usable;
