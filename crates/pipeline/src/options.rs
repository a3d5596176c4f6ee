//! Options of a run besides the configuration, and the report of a run.

use std::path::PathBuf;

use roadplane_geo::Site;
use roadplane_write::Existing;

use crate::CameraConstraints;
use crate::cameras::memory::CameraDatabase;

/// Options of [`run_input`](crate::run_input) besides the configuration.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Folder of the models.
    pub models: PathBuf,
    /// User constraints on the camera.
    pub constraints: CameraConstraints,
    /// The camera database.
    pub cameras: Option<CameraDatabase>,
    /// The camera's position on the map, the same for all inputs.
    pub site: Option<Site>,
    /// How to treat a finished result of the same name.
    pub existing: Existing,
    /// Whether to continue a stopped run and to keep finished results.
    pub resume: bool,
    /// Whether to write the annotated video.
    pub video: bool,
    /// Whether to write the background image: the scene without vehicles.
    pub background: bool,
    /// Whether to keep `frames.jsonl`, the results of perception by frame, in the result.
    pub frames: bool,
    /// Whether this process works on no other input at the same time, so that its processor time is that of this run.
    pub alone: bool,
}

impl RunOptions {
    /// Returns options that write the results alone; a result of the same name must not exist yet.
    #[must_use]
    pub fn new(models: PathBuf) -> Self {
        Self {
            models,
            constraints: CameraConstraints::default(),
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

/// Report of the work on one input.
#[derive(Clone, Debug)]
pub struct RunReport {
    /// Folder of the result.
    pub folder: PathBuf,
    /// Number of tracks; `None` for a piece, and for a result that existed before.
    pub tracks: Option<u64>,
    /// Text about the camera for the log: focal length, height and tilt, or the reason why there are none.
    pub camera: String,
    /// Whether some of the input was lost.
    pub damaged: bool,
    /// Number of frames that could not be decoded.
    pub frames_lost: u64,
}
