//! Row 6 of the tables: our solver on a whole clip. All frames together give one camera, and each track gets one shape.
//! Poses and tracks are then estimated with this camera and these shapes.
//!
//! The estimation is that of `roadplane run`, but the input is the same keypoints as in the other rows.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_base::{FrameRecord, PoseRecord, ShapeAtlas, TrackRow};
use roadplane_pipeline::{CameraConstraints, Cancel, Config, solve_clip};
use roadplane_track::{Evidence, Join};
use roadplane_write::{JsonLines, read_jsonl};

use super::answer::CameraAnswer;
use crate::LabError;

/// The camera, poses and tracks that are estimated for a clip.
#[derive(Clone, Debug)]
pub struct FusedClip {
    /// The estimated camera of the clip's longest time segment; `None` if no camera was estimated.
    pub camera: Option<CameraAnswer>,
    /// The estimated poses: one record per car and frame.
    pub poses: Vec<PoseRecord>,
    /// The smoothed tracks: one row per track and frame.
    pub rows: Vec<TrackRow>,
    /// All that shows whether a track is a vehicle, by the number of the track.
    pub evidence: BTreeMap<u64, Evidence>,
    /// Joins of each track over gaps, by the number of the track.
    pub joins: BTreeMap<u64, Vec<Join>>,
}

/// Estimates the camera, the poses and the tracks of a clip from its keypoints.
///
/// The solve writes its intermediate files into `folder`.
///
/// # Errors
/// [`LabError::Write`] if an intermediate file cannot be written or read; [`LabError::Pipeline`] if the solve fails.
pub fn solve_fused(
    atlas: &ShapeAtlas,
    frames: &[FrameRecord],
    constraints: &CameraConstraints,
    folder: &Path,
    config: &Config,
    cancel: &Cancel,
) -> Result<FusedClip, LabError> {
    let frames_path = folder.join("frames.jsonl");
    let mut lines = JsonLines::create(&frames_path)?;
    for frame in frames {
        lines.write(frame)?;
    }
    lines.finish()?;
    solve_recorded(atlas, &frames_path, constraints, folder, config, cancel)
}

/// Estimates the camera, the poses and the tracks of a clip from the file of frames of a run (`frames.jsonl`).
///
/// The solve writes its intermediate files into `folder`.
///
/// # Errors
/// [`LabError::Write`] if an intermediate file cannot be written or read; [`LabError::Pipeline`] if the solve fails.
pub fn solve_recorded(
    atlas: &ShapeAtlas,
    frames: &Path,
    constraints: &CameraConstraints,
    folder: &Path,
    config: &Config,
    cancel: &Cancel,
) -> Result<FusedClip, LabError> {
    let poses_path = folder.join("poses.jsonl");
    let solution = solve_clip(frames, &poses_path, atlas, constraints, config, cancel)?;
    let longest = solution
        .cameras
        .estimates
        .iter()
        .max_by(|a, b| (a.span_s[1] - a.span_s[0]).total_cmp(&(b.span_s[1] - b.span_s[0])));
    let camera = longest.map(|estimate| CameraAnswer {
        focal_px: estimate.params.focal_px(),
        plane: estimate.params.plane(),
        covariance: estimate.covariance,
    });
    let poses = read_jsonl(&poses_path)?.collect::<Result<_, _>>()?;
    Ok(FusedClip { camera, poses, rows: solution.rows, evidence: solution.evidence, joins: solution.joins })
}
