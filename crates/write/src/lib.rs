//! Writes and reads the files of a result.
//!
//! An [`OutFile`] and an [`OutputFolder`] are written under a temporary name. Each gets its final name when it is
//! complete. Equal input gives equal bytes. Numbers are rounded to fixed steps: 0.1 mm, 1e-5 rad, 0.01 px, 1 µs. The
//! bytes do not depend on hash order, time of day or machine.
//!
//! # Contents
//! - writing in general: `file.rs`, `folder.rs`, `lock.rs`, `spool.rs` (the frames of a run in progress), `digits.rs`,
//!   `schema.rs`
//! - files of a result: `tracks.rs` (`parquet.rs`), `jsonl.rs` (poses, frames), `camera.rs`, `summary.rs` (`speed.rs`),
//!   `evidence.rs`
//! - files of the user: `constraints.rs`, `table.rs`, `track_samples.rs` (any table with tracks)
//! - times of recording: `clip_time.rs`

#![deny(missing_docs)]

mod camera;
mod clip_time;
mod constraints;
mod digits;
mod error;
mod evidence;
mod file;
mod folder;
mod jsonl;
mod lock;
mod parquet;
mod schema;
mod speed;
mod spool;
mod summary;
mod table;
mod track_samples;
mod tracks;

pub use camera::{
    CAMERA_SCHEMA, CameraFile, CameraSegment, FrameMotion, LensFile, read_camera, write_camera,
};
pub use clip_time::{civil_time, seconds_since_1970, start_in_name, time_in_name};
pub use constraints::{CONSTRAINTS_SCHEMA, ConstraintsFile, LengthConstraint, read_constraints};
pub use digits::{decimals, rounded_row};
pub use error::WriteError;
pub use evidence::{EvidenceStore, is_camera_id, read_evidence, write_evidence};
pub use file::OutFile;
pub use folder::{Existing, OutputFolder};
pub use jsonl::{JsonLines, PoseLines, read_jsonl, write_json};
pub use lock::FolderLock;
pub use parquet::{GeometryColumn, TRACKS_SCHEMA, TrackParquet};
pub use schema::{FRAMES_SCHEMA, POSES_SCHEMA, schema, schemas};
pub use speed::{CpuMs, Speed};
pub use spool::{FrameReader, FrameSpool, LensTraces, Recovered, read_lens_traces};
pub use summary::{
    ConstraintSummary, Counts, InputSummary, ModelSummary, NotFollowedInterval, RunStatus, SUMMARY_SCHEMA,
    SceneLinesSummary, StageSeconds, Summary, WatchInterval, WatchSummary, read_summary, write_summary,
};
pub use table::{TableFormat, TableRow, read_table, write_table};
pub use track_samples::{TrackSample, read_track_samples};
pub use tracks::{TrackCsv, TrackFiles};
