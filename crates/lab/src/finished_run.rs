//! The files of a finished run, read back.

use std::collections::BTreeSet;
use std::path::Path;

use roadplane_base::{PoseRecord, TrackRow};
use roadplane_pipeline::Config;
use roadplane_write::{CameraSegment, Summary, read_camera, read_jsonl};

use crate::LabError;
use roadplane_metrics::average_precision::{FoundBox, PictureBoxes};
use roadplane_metrics::scoring::picture_boxes;
use roadplane_metrics::text_file::read_text;
use roadplane_metrics::truth::Truth;

/// The files of a finished run, `DIR/<stem>/`.
#[derive(Clone, Debug)]
pub struct FinishedRun {
    /// The camera; of the longest stretch where it was moved.
    pub camera: CameraSegment,
    /// Rows of `tracks.jsonl`.
    pub rows: Vec<TrackRow>,
    /// Lines of `poses.jsonl`.
    pub poses: Vec<PoseRecord>,
    /// What the run did.
    pub config: Config,
}

impl FinishedRun {
    /// Reads the folder.
    ///
    /// # Errors
    /// [`LabError::Write`], [`LabError::Unreadable`] or [`LabError::Malformed`] for the file that is missing or broken.
    pub fn read(folder: &Path) -> Result<Self, LabError> {
        let path = folder.join("summary.json");
        let malformed = |e: serde_json::Error| LabError::malformed(&path, e);
        let summary: Summary = serde_json::from_str(&read_text(&path)?).map_err(malformed)?;
        Ok(Self {
            camera: read_camera(&folder.join("camera.json"))?.camera,
            rows: read_jsonl(&folder.join("tracks.jsonl"))?.collect::<Result<_, _>>()?,
            poses: read_jsonl(&folder.join("poses.jsonl"))?.collect::<Result<_, _>>()?,
            config: serde_json::from_value(summary.config).map_err(malformed)?,
        })
    }

    /// The frames that the run looked at: those that its configuration leaves out are not missed.
    #[must_use]
    pub fn analysed(&self, truth: &Truth) -> BTreeSet<u64> {
        self.looked_at(truth.frames.iter().map(|frame| (frame.frame, frame.time_s)))
    }

    /// Those of frames in order (index and time, s) that the run looked at.
    pub(crate) fn looked_at(&self, frames: impl Iterator<Item = (u64, f64)>) -> BTreeSet<u64> {
        let decode = &self.config.decode;
        let wanted = frames.filter(|(frame, time_s)| {
            frame.is_multiple_of(u64::from(decode.stride.max(1)))
                && *time_s >= decode.start_s
                && decode.end_s.is_none_or(|end| *time_s < end)
        });
        let most = decode.max_frames.and_then(|most| usize::try_from(most).ok()).unwrap_or(usize::MAX);
        wanted.take(most).map(|(frame, _)| frame).collect()
    }

    /// Boxes of a frame; a run keeps those of cars that it solved.
    pub(crate) fn boxes(&self, frame: u64) -> Vec<FoundBox> {
        let here = self.poses.iter().filter(|pose| pose.frame == frame);
        here.map(|pose| FoundBox { bbox_px: pose.bbox_px, score: pose.score }).collect()
    }
}

/// Boxes of each frame looked at.
pub(crate) fn pictures(run: &FinishedRun, truth: &Truth, frames: &BTreeSet<u64>) -> Vec<PictureBoxes> {
    let looked_at = truth.frames.iter().filter(|frame| frames.contains(&frame.frame));
    looked_at.map(|frame| picture_boxes(truth, frame, run.boxes(frame.frame))).collect()
}
