//! JSON schemas of the result files, generated from the Rust types. Doc comments become the descriptions in a schema.

use roadplane_base::{FrameRecord, PoseRecord, TrackRow};
use schemars::{JsonSchema, schema_for};
use serde_json::{Value, json};

use crate::camera::{CAMERA_SCHEMA, CameraFile};
use crate::constraints::{CONSTRAINTS_SCHEMA, ConstraintsFile};
use crate::parquet::TRACKS_SCHEMA;
use crate::summary::{SUMMARY_SCHEMA, Summary};

/// Schema id of a line of `poses.jsonl`.
pub const POSES_SCHEMA: &str = "roadplane.poses/1";
/// Schema id of a line of `frames.jsonl`.
pub const FRAMES_SCHEMA: &str = "roadplane.frames/1";

/// Returns the names and schemas (JSON Schema 2020-12) of the result files and of the input file of `--known`.
///
/// The schema `tracks` describes a line of `tracks.jsonl` and a row of `tracks.parquet`. In `tracks.csv`, the bounding
/// box has four columns instead of one. The schemas `poses` and `frames` describe one line of a file. The schemas
/// `camera`, `summary` and `known` describe a whole file.
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

/// Returns the schema of a type, with `id` as its `$id`.
#[must_use]
pub fn schema<T: JsonSchema>(id: &str) -> Value {
    let mut schema = schema_for!(T).to_value();
    unwrap_descriptions(&mut schema);
    if let Some(object) = schema.as_object_mut() {
        object.insert("$id".to_owned(), json!(id));
    }
    schema
}

/// Joins the wrapped lines in all descriptions of a schema. Each paragraph becomes one line.
fn unwrap_descriptions(schema: &mut Value) {
    match schema {
        Value::Object(object) => {
            if let Some(Value::String(text)) = object.get_mut("description") {
                let paragraphs: Vec<String> =
                    text.split("\n\n").map(|part| part.replace('\n', " ")).collect();
                *text = paragraphs.join("\n\n");
            }
            object.values_mut().for_each(unwrap_descriptions);
        }
        Value::Array(items) => items.iter_mut().for_each(unwrap_descriptions),
        _ => {}
    }
}
