//! Options of a run that are not in the configuration, and the report of a run.

use std::path::PathBuf;

use roadplane_geo::Site;
use roadplane_write::{Existing, RunStatus};

use crate::CameraConstraints;
use crate::cameras::database::CameraDatabase;

/// Options of [`run_input`](crate::run_input) that are not in the configuration.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Folder that contains the model files of the nets.
    pub models: PathBuf,
    /// User constraints on the camera.
    pub constraints: CameraConstraints,
    /// The camera database: evidence about cameras from earlier clips. `None` if it is not used.
    pub cameras: Option<CameraDatabase>,
    /// The camera's position on the map, which is the same for all inputs.
    pub site: Option<Site>,
    /// Whether a finished result of the same name is replaced.
    pub existing: Existing,
    /// Whether to continue a stopped run. Finished results are then kept and not computed again.
    pub resume: bool,
    /// Whether to write a video of the input with the result drawn on it.
    pub video: bool,
    /// Whether to write the background image: the scene without vehicles.
    pub background: bool,
    /// Whether to keep `frames.jsonl` in the result. This file has the results of perception for each frame.
    pub frames: bool,
    /// Whether this process works on one input at a time. The processor time of the process is then the cost of the
    /// run.
    pub alone: bool,
}

impl RunOptions {
    /// Returns options for a run that writes only the standard results. The run fails if a result of the same name
    /// exists.
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

/// Report of a run on one input.
#[derive(Clone, Debug)]
pub struct RunReport {
    /// Folder of the result.
    pub folder: PathBuf,
    /// Number of tracks. `None` for a piece of an input, and for a result that an earlier run finished.
    pub tracks: Option<u64>,
    /// Text about the camera for the log: focal length, height and tilt, or the reason why they are absent.
    pub camera: String,
    /// Outcome of the run. For a piece, it is complete or damaged.
    pub status: RunStatus,
    /// Number of frames that could not be decoded.
    pub frames_lost: u64,
    /// Number of frames in which vehicles were not followed, because the camera moved. It is 0 for a piece, as only the
    /// joined result has this count.
    pub frames_not_followed: u64,
}

impl RunReport {
    /// Whether a part of the input is missing from the result: lost, damaged or not followed.
    #[must_use]
    pub fn is_partial(&self) -> bool {
        self.status != RunStatus::Complete
    }
}
