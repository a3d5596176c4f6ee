//! Joins the stages: threads and bounded channels for the streaming half, the clip's solve for the other, configuration,
//! cancellation, and what each command of the binary does.
//!
//! # Contents
//! Data flows from top to bottom.
//! ```text
//! stream/     pictures → frames.jsonl: streaming.rs over flow.rs (a thread a stage), with watched.rs, scene_lines.rs, stills.rs,
//!             samples.rs, speed.rs; left.rs writes it and what else is needed
//! cameras/    frames → the camera at every time: windows → joint solves → one camera a stretch of time; what is known.rs,
//!             remembered (memory.rs), and the lens.rs
//! tracks/     frames and camera → tracks: each car (cars.rs, ground_contact.rs, hidden.rs), what is believed (believe.rs), a pass
//!             over a stretch (pass.rs, stretch.rs), what tracks do (activities.rs)
//! clip.rs     cameras, then tracks, of a whole clip
//! output/     the solved clip → files (finish.rs, track_rows.rs), report and video (draw.rs, losses.rs)
//! commands/   run.rs, piece.rs and join.rs, stage_files.rs, solve_file.rs, track_file.rs, colours.rs, distance.rs, bench.rs, doctor.rs
//! around      config.rs, models.rs, identity.rs, limits.rs, progress.rs, cancel.rs, error.rs
//! ```

mod cameras;
mod cancel;
mod clip;
mod commands;
mod config;
mod error;
mod identity;
mod limits;
mod models;
mod output;
mod progress;
mod stream;
mod tracks;

pub use cameras::known::{Known, KnownOptions, Measured};
pub use cameras::krtd::{Krtd, read_krtd};
pub use cameras::memory::{CameraMemory, KnownCamera, known_cameras, merge_cameras};
pub use cameras::usable;
pub use cancel::Cancel;
pub use clip::{ClipSolution, solve_clip};
pub use commands::bench::{DecodeCost, forget_peak_memory, measure_decoding};
pub use commands::colours::track_colours;
pub use commands::distance::{Distance, distances};
pub use commands::doctor::{Check, check_up};
pub use commands::join::{inputs_of, join_pieces};
pub use commands::piece::{PlannedPiece, Span, plan, run_piece, schemas};
pub use commands::run::{RunOptions, RunReport, run_input, stem_of};
pub use commands::solve_file::{SolveOptions, solve_file};
pub use commands::stage_files::{detect_file, keypoints_file};
pub use commands::track_file::track_file;
pub use config::{Config, ConfigError};
pub use error::{Fault, PipelineError};
pub use limits::too_small_address_space;
pub use models::{find_models, find_runtime};
pub use output::draw::render_run;
pub use progress::{Progress, Silent};
pub use roadplane_write::{EvidenceStore, Existing, FolderLock, WriteError};
pub use stream::scene_lines::SceneView;
pub use stream::streaming::{Nets, open_detector, open_input, open_keypoints};
pub use tracks::activities::{activity_file, open_activity, track_motion};
