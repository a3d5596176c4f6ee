//! What a caller of a run chooses besides the configuration, and what comes of it.

use std::path::PathBuf;

use roadplane_geo::Site;
use roadplane_write::Existing;

use crate::CameraConstraints;
use crate::cameras::memory::CameraDatabase;

/// What a caller of [`run_input`](crate::run_input) chooses besides the configuration.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Folder of the models.
    pub models: PathBuf,
    /// What is known of the camera.
    pub known: CameraConstraints,
    /// What is remembered of the cameras.
    pub cameras: Option<CameraDatabase>,
    /// Where the camera stands on the map; one for all inputs.
    pub site: Option<Site>,
    /// What to do about a finished result of the same name.
    pub existing: Existing,
    /// Go on where a stopped run ended; leave finished results alone.
    pub resume: bool,
    /// Also write the annotated video.
    pub video: bool,
    /// Also write the empty place as a picture.
    pub background: bool,
    /// Leave what the streaming half found, frame by frame, in the result: `frames.jsonl`.
    pub frames: bool,
    /// No other input is worked on in this process at the same time: its processor time is this run's.
    pub alone: bool,
}

impl RunOptions {
    /// Nothing asked for beside the results, which must not be there yet.
    #[must_use]
    pub fn new(models: PathBuf) -> Self {
        Self {
            models,
            known: CameraConstraints::default(),
            cameras: None,
            site: None,
            existing: Existing::Refuse,
            resume: false,
            video: false,
            background: false,
            frames: false,
            alone: false,
        }
    }
}

/// What came of one input.
#[derive(Clone, Debug)]
pub struct RunReport {
    /// The result.
    pub folder: PathBuf,
    /// Tracks in it; `None` for a result that was there before.
    pub tracks: Option<u64>,
    /// The camera in words.
    pub camera: String,
    /// Some of the input was lost.
    pub damaged: bool,
    /// Frames that could not be decoded.
    pub frames_lost: u64,
}
