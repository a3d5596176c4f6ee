//! `summary.json`: the input, versions, settings, counts, warnings and times of a run.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_base::{CameraMove, NotFollowedReason, PictureVerdict};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::digits::decimals;
use crate::speed::Speed;
use crate::{WriteError, write_json};

/// Schema id of `summary.json`.
pub const SUMMARY_SCHEMA: &str = "roadplane.summary/1";

/// The outcome of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunStatus {
    /// The whole input was read.
    #[default]
    Complete,
    /// A part of the input was damaged or lost. `counts` contains the number of lost frames.
    InputDamaged,
    /// The input was read, but the camera moved in more than 5 % of its frames. Vehicles in these frames were not
    /// followed.
    PartlyFollowed,
    /// The input was read, but the surveyed points of the user contradict the camera. Camera and tracks were estimated
    /// without them, and the result is not on the map.
    PointsNotUsed,
}

/// The input, versions, settings, counts, warnings and times of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "summary: one object per clip")]
pub struct Summary {
    /// Id of the schema: `roadplane.summary/1`.
    #[schemars(extend("const" = SUMMARY_SCHEMA))]
    pub schema: String,
    /// Outcome of the run.
    pub status: RunStatus,
    /// Exit code of the run: 0, or 3 if the input is damaged or only partly followed.
    #[schemars(extend("enum" = [0, 3]))]
    pub exit_code: u8,
    /// Versions of the program and its libraries by name, such as `roadplane`, `onnxruntime`, `opencv`.
    pub versions: BTreeMap<String, String>,
    /// The input of the run.
    pub input: InputSummary,
    /// Neural nets that ran.
    pub models: Vec<ModelSummary>,
    /// All settings of the run, after defaults, files and command-line options were combined.
    pub config: serde_json::Value,
    /// sha256 of `config`, hexadecimal.
    pub config_sha256: String,
    /// Counts of frames, boxes, poses and tracks.
    pub counts: Counts,
    /// Camera moves and the state of the camera over time.
    #[serde(default)]
    pub watch: WatchSummary,
    /// Working time of each stage of the pipeline, in the order of the stages.
    pub seconds: Vec<StageSeconds>,
    /// Wall-clock time of the run, s.
    pub wall_s: f64,
    /// Number of frames read per second of wall-clock time.
    #[schemars(range(min = 0))]
    pub frames_per_s: f64,
    /// Processing time by stage, and amount of work. Absent in files of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<Speed>,
    /// Peak memory of the process, bytes; null if the system does not report it.
    pub peak_memory_bytes: Option<u64>,
    /// User constraints on the camera. Each constraint is compared with the estimate from all other evidence. Absent if
    /// there are no user constraints.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub known: Vec<ConstraintSummary>,
    /// Vertical lines and turns as evidence on the camera, one entry per camera position. Absent if there
    /// are no entries.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scene_lines: Vec<SceneLinesSummary>,
    /// Warnings about the results, one sentence each.
    pub warnings: Vec<String>,
}

/// The input of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct InputSummary {
    /// Path of the input, as given on the command line.
    pub path: String,
    /// Size of the input, bytes. For a folder, it is the sum of the sizes of its files.
    pub bytes: u64,
    /// sha256 of the input, hexadecimal. For a folder, it is the sha256 of the contents of all files in order.
    pub sha256: String,
}

/// A user constraint on the camera, compared with the estimate from all other evidence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ConstraintSummary {
    /// Name of the constraint, such as `focal length` or `length of line 2 of bays.csv`.
    pub what: String,
    /// Unit of the values and standard deviations: `px`, `m` or `°`.
    #[schemars(extend("enum" = ["px", "m", "°"]))]
    pub unit: String,
    /// Value that the user gave, in `unit`.
    pub given: f64,
    /// Standard deviation of `given`, in `unit`. For a length, it includes the uncertainty of both end pixels.
    #[schemars(range(min = 0))]
    pub given_sd: f64,
    /// Estimate of the same quantity from all other evidence, in `unit`. This evidence is the cars, the prior and the
    /// other user constraints.
    pub by_all_else: f64,
    /// Standard deviation of `by_all_else`, in `unit`.
    #[schemars(range(min = 0))]
    pub by_all_else_sd: f64,
    /// Absolute difference between `given` and `by_all_else`, divided by the standard deviation of this difference. The
    /// program warns if the result is above 3.
    #[schemars(range(min = 0))]
    pub apart_sds: f64,
}

/// Vertical lines and turns of the camera at one position of the camera, and their use in its estimate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SceneLinesSummary {
    /// Index of the camera position, from 0. A camera that returns to a position has the same index again.
    pub segment: usize,
    /// Number of straight edges in the picture that may be vertical in the scene.
    pub found: usize,
    /// Number of edges that are vertical in the scene. It is 0 if the edges do not determine the vertical vanishing
    /// point. In that case the estimate uses no edges.
    pub upright: usize,
    /// Natural logarithm of the likelihood ratio between two hypotheses: the edges share a vertical vanishing point, or
    /// their directions are random. It is null if the estimate uses no edges.
    pub gain: Option<f64>,
    /// Focal length from turns and zooms of the camera, px. Absent if the camera did not turn far enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub turn_focal_px: Option<f64>,
    /// Standard deviation of `turn_focal_px`, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0))]
    pub turn_focal_sd_px: Option<f64>,
}

/// A neural net that ran.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ModelSummary {
    /// Name of the net according to its model card.
    pub name: String,
    /// Version of the net according to its model card.
    pub version: String,
    /// sha256 of the net's file, hexadecimal.
    pub sha256: String,
    /// Device that ran the net, and numeric precision, such as `cpu f32`.
    pub provider: String,
}

/// Camera moves, and the state of the camera over time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WatchSummary {
    /// Camera moves in the order of time.
    pub moves: Vec<CameraMove>,
    /// State of the camera over time. Each entry is an interval in which the state does not change.
    pub stretches: Vec<WatchInterval>,
    /// Largest shift of the picture by camera shake, px. A shift below half a pixel counts as 0.
    #[schemars(range(min = 0))]
    pub farthest_shake_px: f64,
    /// Sd of the difference between the time stamp of a frame and the time at which its picture was taken, s. The
    /// tracks correct such differences. 0 if the time stamps are right, or if too few vehicles show the differences.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub time_sd_s: f64,
    /// Time in which vehicles were not followed because the camera moved, s.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub not_followed_s: f64,
    /// Share of the frames in which vehicles were not followed because the camera moved, 0 to 1.
    #[serde(default)]
    #[schemars(range(min = 0, max = 1))]
    pub not_followed_share: f64,
    /// The intervals in which vehicles were not followed because the camera moved. Absent if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_followed: Vec<NotFollowedInterval>,
}

/// An interval in which vehicles were not followed because of the motion of the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NotFollowedInterval {
    /// Reason why the vehicles were not followed.
    pub reason: NotFollowedReason,
    /// Presentation time of the first frame of the interval, s.
    pub from_s: f64,
    /// Presentation time of the last frame of the interval, s.
    pub to_s: f64,
}

/// An interval in which the state of the camera does not change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WatchInterval {
    /// State of the camera in the interval.
    pub verdict: PictureVerdict,
    /// Presentation time of the first frame of the interval, s.
    pub from_s: f64,
    /// Presentation time of the last frame of the interval, s.
    pub to_s: f64,
}

/// Counts of frames, boxes, poses and tracks.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Counts {
    /// Number of frames according to the input; null if the input does not state a number.
    pub frames_expected: Option<u64>,
    /// Number of frames decoded.
    pub frames_read: u64,
    /// Number of frames lost by damage.
    pub frames_lost: u64,
    /// Number of decoded frames that were not processed because of the settings.
    pub frames_skipped: u64,
    /// Number of frames in which vehicles were not followed because the camera moved, or may have moved at the end of
    /// the clip.
    #[serde(default)]
    pub frames_not_followed: u64,
    /// Number of detected boxes by class of vehicle. Boxes without a measurement of their own (`held_since`,
    /// `pose_from`, `seen_after`) do not count.
    pub boxes: BTreeMap<String, u64>,
    /// Number of rejected cars by reason of rejection.
    pub rejected: BTreeMap<String, u64>,
    /// Number of poses that the tracker uses. A pose belongs to one car in one frame.
    pub poses_used: u64,
    /// Number of tracks.
    pub tracks: u64,
    /// Number of tracks that were left out because they are probably no vehicles: their `exists_p` is below the setting
    /// `track.min_exists_p`, or most of their boxes contradict their positions. Files of older versions lack this
    /// count, and it is read as 0.
    #[serde(default)]
    pub tracks_left_out: u64,
    /// Number of rows in the track files.
    pub track_rows: u64,
}

/// The working time of one stage of the pipeline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageSeconds {
    /// Name of the stage.
    pub stage: String,
    /// Working time of the stage, s. Waiting time is not included.
    #[schemars(range(min = 0))]
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
    summary.watch.not_followed_s = decimals(summary.watch.not_followed_s, 3);
    summary.watch.not_followed_share = decimals(summary.watch.not_followed_share, 4);
    summary.seconds.iter_mut().for_each(|s| s.seconds = decimals(s.seconds, 3));
    summary.speed = summary.speed.map(|speed| speed.rounded());
    write_json(path, &summary)
}

/// Reads `summary.json`.
///
/// # Errors
/// [`WriteError::Malformed`] if the file is not a valid `summary.json`; [`WriteError::Io`].
pub fn read_summary(path: &Path) -> Result<Summary, WriteError> {
    let text = std::fs::read(path).map_err(WriteError::io("read", path))?;
    serde_json::from_slice(&text).map_err(|e| WriteError::malformed(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_is_read_back_unchanged() {
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
