//! Row 6: our solver fused over a clip: one camera from all frames, one shape per track, and poses and tracks with
//! both. It is the estimation of `roadplane run`, from the same keypoints as the other rows.

use std::path::Path;

use roadplane_base::{FrameRecord, PoseRecord, ShapeAtlas, TrackRow};
use roadplane_pipeline::{CameraConstraints, Cancel, Config, solve_clip};
use roadplane_write::{JsonLines, read_jsonl};

use super::answer::CameraAnswer;
use crate::LabError;

/// The solution of a clip.
#[derive(Clone, Debug)]
pub struct FusedClip {
    /// The camera of the clip's longest segment.
    pub camera: Option<CameraAnswer>,
    /// One record for every car and frame with a pose.
    pub poses: Vec<PoseRecord>,
    /// The smoothed tracks.
    pub rows: Vec<TrackRow>,
}

/// Solves a clip. The intermediate files of the solve go to `folder`.
///
/// # Errors
/// [`LabError::Write`] or [`LabError::Pipeline`].
pub fn solve_fused(
    atlas: &ShapeAtlas,
    frames: &[FrameRecord],
    constraints: &CameraConstraints,
    folder: &Path,
    config: &Config,
    cancel: &Cancel,
) -> Result<FusedClip, LabError> {
    let (frames_path, poses_path) = (folder.join("frames.jsonl"), folder.join("poses.jsonl"));
    let mut lines = JsonLines::create(&frames_path)?;
    for frame in frames {
        lines.write(frame)?;
    }
    lines.finish()?;
    let solution = solve_clip(&frames_path, &poses_path, atlas, constraints, config, cancel)?;
    let longest = solution
        .cameras
        .estimates()
        .iter()
        .max_by(|a, b| (a.span_s[1] - a.span_s[0]).total_cmp(&(b.span_s[1] - b.span_s[0])));
    let camera = longest.map(|estimate| CameraAnswer {
        focal_px: estimate.params.focal_px(),
        plane: estimate.params.plane(),
        covariance: estimate.covariance,
    });
    let poses = read_jsonl(&poses_path)?.collect::<Result<_, _>>()?;
    Ok(FusedClip { camera, poses, rows: solution.rows })
}
