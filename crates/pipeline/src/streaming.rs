//! The left half of a run: decode → detect → keypoints, frame by frame.

use std::path::Path;

use roadplane_decode::{DecodeReport, Input, open};
use roadplane_detect::Detector;
use roadplane_infer::{Session, SessionOptions};
use roadplane_keypoints::KeypointNet;
use roadplane_write::ModelSummary;

use crate::flow::{Stage, StageTime, Work, flow};
use crate::{Cancel, Config, PipelineError, Progress};

/// The nets of a run.
pub struct Nets {
    /// Finds vehicles.
    pub detector: Detector,
    /// Finds their keypoints.
    pub keypoints: KeypointNet,
}

impl Nets {
    /// Loads both from the models folder.
    ///
    /// # Errors
    /// [`PipelineError`] when a model is refused or the runtime is missing.
    pub fn open(models: &Path, config: &Config) -> Result<Self, PipelineError> {
        Ok(Self { detector: open_detector(models, config)?, keypoints: open_keypoints(models, config)? })
    }

    /// What they are, for the summary.
    #[must_use]
    pub fn summaries(&self) -> Vec<ModelSummary> {
        self.sessions().map(summary_of).to_vec()
    }

    /// What their results depend on: weights, what computes them, and how outputs become measurements.
    #[must_use]
    pub fn fingerprints(&self) -> Vec<String> {
        let of = |session: &Session| {
            let card = session.card();
            let calibration = serde_json::Value::Object(card.calibration.clone());
            format!("{} {} {calibration}", card.sha256, session.provider())
        };
        self.sessions().map(of).to_vec()
    }

    fn sessions(&self) -> [&Session; 2] {
        [self.detector.session(), self.keypoints.session()]
    }
}

/// The detector alone.
///
/// # Errors
/// [`PipelineError`] when the model is refused or the runtime is missing.
pub fn open_detector(models: &Path, config: &Config) -> Result<Detector, PipelineError> {
    let session = Session::open(&models.join(&config.models.detector), &session_options(config))?;
    Ok(Detector::new(session, config.detect.clone())?)
}

/// The keypoint net alone.
///
/// # Errors
/// [`PipelineError`] when the model is refused or the runtime is missing.
pub fn open_keypoints(models: &Path, config: &Config) -> Result<KeypointNet, PipelineError> {
    let card = models.join(&config.models.keypoints);
    Ok(KeypointNet::open(&card, &session_options(config), config.keypoints.clone())?)
}

fn session_options(config: &Config) -> SessionOptions {
    SessionOptions { provider: config.infer.provider, threads: config.infer.threads, library: None }
}

fn summary_of(session: &Session) -> ModelSummary {
    let card = session.card();
    ModelSummary {
        name: card.name.clone(),
        version: card.version_text(),
        sha256: card.sha256.clone(),
        provider: session.provider().to_string(),
    }
}

/// What streaming an input came to.
#[derive(Debug)]
pub struct Streamed {
    /// What became of the frames.
    pub decode: DecodeReport,
    /// Work of each stage.
    pub times: Vec<StageTime>,
}

/// Opens an input as the configuration says.
///
/// # Errors
/// [`PipelineError::Decode`] when it cannot be used.
pub fn open_input(input: &Path, config: &Config) -> Result<Input, PipelineError> {
    Ok(open(input, &config.decode)?)
}

/// The stage that finds vehicles.
pub fn detect_stage(detector: &mut Detector) -> Stage<'_> {
    Stage::new("detect", |work: &mut Work| {
        work.record.cars = detector.detect(&work.frame)?;
        Ok(())
    })
}

/// The stage that finds keypoints.
pub fn keypoint_stage(net: &mut KeypointNet) -> Stage<'_> {
    Stage::new("keypoints", |work: &mut Work| Ok(net.locate(&work.frame, &mut work.record.cars)?))
}

/// Sends every frame of `input` through the stages into `sink`.
///
/// # Errors
/// The first stage's error, or [`PipelineError::Stopped`].
pub fn stream(
    mut input: Input,
    stages: Vec<Stage<'_>>,
    mut sink: impl FnMut(Work) -> Result<(), PipelineError>,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Streamed, PipelineError> {
    progress.expect(input.frames_hint());
    let size = input.size();
    let frame_bytes = 3 * u64::from(size.width) * u64::from(size.height);
    // Memory, not frames, is what is bounded: large pictures leave room for fewer between two stages.
    let budget = config.pipeline.buffer_mib * (1 << 20) / (stages.len() as u64 + 1);
    let capacity = (budget / frame_bytes.max(1)).clamp(1, 64) as usize;
    let source_input = &mut input;
    let source = move || Ok(source_input.next_frame()?);
    let counted = |work: Work| {
        sink(work)?;
        progress.frame_done();
        Ok(())
    };
    let times = flow("decode", source, stages, counted, capacity, cancel)?;
    Ok(Streamed { decode: input.report().clone(), times })
}
