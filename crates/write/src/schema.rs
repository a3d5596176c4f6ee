//! What the files of a result hold, as JSON schemas: made from the types that are written, their docs being the descriptions.

use roadplane_base::{FrameRecord, PoseRecord, TrackRow};
use schemars::{JsonSchema, schema_for};
use serde_json::{Value, json};

use crate::camera::{CAMERA_SCHEMA, CameraFile};
use crate::constraints::{CONSTRAINTS_SCHEMA, ConstraintsFile};
use crate::parquet::TRACKS_SCHEMA;
use crate::summary::{SUMMARY_SCHEMA, Summary};

/// Schema of a line of `poses.jsonl`.
pub const POSES_SCHEMA: &str = "roadplane.poses/1";
/// Schema of a line of `frames.jsonl`.
pub const FRAMES_SCHEMA: &str = "roadplane.frames/1";

/// Name and schema (JSON Schema 2020-12) of every file of a result: `tracks` for a line of `tracks.jsonl`, a row of `tracks.csv` (the box in
/// four columns) and of `tracks.parquet`; `poses` and `frames` for a line; `camera` and `summary` for the file; `known` for what `--known` reads.
#[must_use]
pub fn schemas() -> Vec<(&'static str, Value)> {
    vec![
        ("tracks", schema::<TrackRow>(TRACKS_SCHEMA)),
        ("camera", schema::<CameraFile>(CAMERA_SCHEMA)),
        ("poses", schema::<PoseRecord>(POSES_SCHEMA)),
        ("frames", schema::<FrameRecord>(FRAMES_SCHEMA)),
        ("summary", schema::<Summary>(SUMMARY_SCHEMA)),
        ("known", schema::<ConstraintsFile>(CONSTRAINTS_SCHEMA)),
    ]
}

/// The schema of a type, under a name.
#[must_use]
pub fn schema<T: JsonSchema>(id: &str) -> Value {
    let mut schema = schema_for!(T).to_value();
    if let Some(object) = schema.as_object_mut() {
        object.insert("$id".to_owned(), json!(id));
    }
    schema
}
