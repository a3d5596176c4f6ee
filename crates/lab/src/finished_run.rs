//! Reads back the files of a finished run.

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

/// The content of the folder of a finished run, `DIR/<stem>/`.
#[derive(Clone, Debug)]
pub struct FinishedRun {
    /// The estimated camera. If the camera was moved during the clip, this is the estimate for the longest time
    /// segment.
    pub camera: CameraSegment,
    /// Rows of `tracks.jsonl`.
    pub rows: Vec<TrackRow>,
    /// Lines of `poses.jsonl`.
    pub poses: Vec<PoseRecord>,
    /// The configuration of the run.
    pub config: Config,
}

impl FinishedRun {
    /// Reads the files in the folder of a finished run.
    ///
    /// # Errors
    /// [`LabError::Write`] or [`LabError::Metrics`] if a file is missing or broken.
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

    /// Returns the indices of the frames that the run processed and that have truth.
    ///
    /// The configuration of a run can leave out frames.
    #[must_use]
    pub fn analysed(&self, truth: &Truth) -> BTreeSet<u64> {
        self.processed(truth.frames.iter().map(|frame| (frame.frame, frame.time_s)))
    }

    /// Returns the indices of those `frames` that the run processed. Each input frame is a pair of index and time (s),
    /// in order of time.
    pub(crate) fn processed(&self, frames: impl Iterator<Item = (u64, f64)>) -> BTreeSet<u64> {
        let decode = &self.config.decode;
        let wanted = frames.filter(|(frame, time_s)| {
            frame.is_multiple_of(u64::from(decode.stride.max(1)))
                && *time_s >= decode.start_s
                && decode.end_s.is_none_or(|end| *time_s < end)
        });
        let most = decode.max_frames.and_then(|most| usize::try_from(most).ok()).unwrap_or(usize::MAX);
        wanted.take(most).map(|(frame, _)| frame).collect()
    }

    /// Returns the found boxes of a frame. A run stores only the boxes of cars with a pose.
    pub(crate) fn boxes(&self, frame: u64) -> Vec<FoundBox> {
        let here = self.poses.iter().filter(|pose| pose.frame == frame);
        here.map(|pose| FoundBox { bbox_px: pose.bbox_px, score: pose.score }).collect()
    }
}

/// Returns the number of tracks that rows belong to.
pub(crate) fn track_count(rows: &[TrackRow]) -> usize {
    rows.iter().map(|row| row.track).collect::<BTreeSet<_>>().len()
}

/// Returns the true and found boxes of each of the given frames.
pub(crate) fn pictures(run: &FinishedRun, truth: &Truth, frames: &BTreeSet<u64>) -> Vec<PictureBoxes> {
    let processed = truth.frames.iter().filter(|frame| frames.contains(&frame.frame));
    processed.map(|frame| picture_boxes(truth, frame, run.boxes(frame.frame))).collect()
}
