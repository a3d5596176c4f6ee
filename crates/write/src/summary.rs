//! `summary.json`: what went in, what came out, how long it took and what was lost.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_base::{CameraMove, PictureVerdict};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::digits::decimals;
use crate::speed::Speed;
use crate::{WriteError, write_json};

/// Schema of `summary.json`.
pub const SUMMARY_SCHEMA: &str = "roadplane.summary/1";

/// How a run ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunStatus {
    /// Everything was read and written.
    #[default]
    Complete,
    /// Some of the input was damaged or lost; the counts say how much.
    InputDamaged,
}

/// The file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Summary {
    /// [`SUMMARY_SCHEMA`].
    pub schema: String,
    /// How the run ended.
    pub status: RunStatus,
    /// Exit code that this result asks for: 0, or 3 for a damaged input.
    pub exit_code: u8,
    /// Program and libraries by name, e.g. `roadplane`, `onnxruntime`, `opencv`.
    pub versions: BTreeMap<String, String>,
    /// What was read.
    pub input: InputSummary,
    /// Networks that ran.
    pub models: Vec<ModelSummary>,
    /// The resolved configuration.
    pub config: serde_json::Value,
    /// sha256 of it, hex.
    pub config_sha256: String,
    /// What was read, lost, rejected, found.
    pub counts: Counts,
    /// What watching the pictures came to.
    #[serde(default)]
    pub watch: WatchSummary,
    /// Work of each stage, in order of the flow.
    pub seconds: Vec<StageSeconds>,
    /// Wall-clock time of the run, s.
    pub wall_s: f64,
    /// Frames read a second of wall-clock time.
    pub frames_per_s: f64,
    /// What the run cost, by stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<Speed>,
    /// Most memory that the process held, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// What was told of the camera, against what everything else says.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub known: Vec<ConstraintSummary>,
    /// Lines of the scene that were looked at for its vertical, by the camera's position.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scene_lines: Vec<SceneLinesSummary>,
    /// What a reader of the results should know.
    pub warnings: Vec<String>,
}

/// The input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct InputSummary {
    /// As given on the command line.
    pub path: String,
    /// Size; of all files for a folder.
    pub bytes: u64,
    /// sha256, hex; of a folder: of its files' contents in order.
    pub sha256: String,
}

/// Something that was told of the camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ConstraintSummary {
    /// What, e.g. `focal length`, `length of line 2 of bays.csv`.
    pub what: String,
    /// Unit of the numbers: `px`, `m` or `°`.
    pub unit: String,
    /// The value that was told.
    pub given: f64,
    /// Its standard deviation.
    pub given_sd: f64,
    /// The value by everything else: cars, prior, and what else was told.
    pub by_all_else: f64,
    /// Its standard deviation.
    pub by_all_else_sd: f64,
    /// How far they are apart, in standard deviations of the difference; beyond 3 there is a warning.
    pub apart_sds: f64,
}

/// Lines of the scene and parallel cars, and whether they spoke of the camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SceneLinesSummary {
    /// Position of the camera, from 0: 1 after its first move.
    pub segment: usize,
    /// Straight edges that may be vertical.
    pub found: usize,
    /// How many are; 0 where they do not show the vertical, and do not count.
    pub upright: usize,
    /// Natural log of how many times better than chance the vertical explains the edges; null where it does not count.
    pub gain: Option<f64>,
    /// Cars whose being parallel speaks of the focal length; 0 where too few are.
    #[serde(default)]
    pub parallel_cars: usize,
}

/// A network.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ModelSummary {
    /// Name on its card.
    pub name: String,
    /// Version on its card.
    pub version: String,
    /// sha256 of the file, hex.
    pub sha256: String,
    /// What ran it, e.g. `cpu f32`.
    pub provider: String,
}

/// What watching the pictures came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WatchSummary {
    /// When the camera was moved, and how.
    pub moves: Vec<CameraMove>,
    /// What the pictures showed, a stretch of time each.
    pub stretches: Vec<WatchStretch>,
    /// Farthest that the picture was shaken, px; 0 below half a px.
    pub farthest_shake_px: f64,
}

/// A stretch of time in which pictures said the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WatchStretch {
    /// What they said.
    pub verdict: PictureVerdict,
    /// Time of the first frame, s.
    pub from_s: f64,
    /// Time of the last frame, s.
    pub to_s: f64,
}

/// Counts of everything read, lost, rejected and found.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Counts {
    /// Frames that the input says it has, where it says so.
    pub frames_expected: Option<u64>,
    /// Frames decoded.
    pub frames_read: u64,
    /// Frames that damage took.
    pub frames_lost: u64,
    /// Frames not looked at on purpose.
    pub frames_skipped: u64,
    /// Boxes found by class.
    pub boxes: BTreeMap<String, u64>,
    /// Cars dropped, by reason.
    pub rejected: BTreeMap<String, u64>,
    /// Cars (car and frame) with a pose that is used.
    pub poses_used: u64,
    /// Tracks.
    pub tracks: u64,
    /// Rows of the track files.
    pub track_rows: u64,
}

/// Time of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageSeconds {
    /// Name of the stage.
    pub stage: String,
    /// Seconds of work, not of waiting.
    pub seconds: f64,
}

/// Writes `summary.json`.
///
/// # Errors
/// [`WriteError::Io`], [`WriteError::DiskFull`].
pub fn write_summary(path: &Path, summary: &Summary) -> Result<(), WriteError> {
    let mut summary = summary.clone();
    SUMMARY_SCHEMA.clone_into(&mut summary.schema);
    summary.wall_s = decimals(summary.wall_s, 3);
    summary.frames_per_s = decimals(summary.frames_per_s, 3);
    summary.seconds.iter_mut().for_each(|s| s.seconds = decimals(s.seconds, 3));
    summary.speed = summary.speed.map(|speed| speed.rounded());
    write_json(path, &summary)
}

/// Reads `summary.json`.
///
/// # Errors
/// [`WriteError::Malformed`] if it is no such file, [`WriteError::Io`].
pub fn read_summary(path: &Path) -> Result<Summary, WriteError> {
    let text = std::fs::read(path).map_err(WriteError::io("read", path))?;
    serde_json::from_slice(&text).map_err(|e| WriteError::malformed(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn survives() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("summary.json");
        let summary = Summary {
            schema: SUMMARY_SCHEMA.to_owned(),
            status: RunStatus::InputDamaged,
            exit_code: 3,
            config: serde_json::json!({"solve": {"max_iters": 50}}),
            seconds: vec![StageSeconds { stage: "decode".to_owned(), seconds: 1.25 }],
            warnings: vec!["3 frames lost".to_owned()],
            ..Summary::default()
        };
        write_summary(&path, &summary).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("\"status\": \"input_damaged\""), "{text}");
        assert_eq!(read_summary(&path).unwrap(), summary);
    }
}
