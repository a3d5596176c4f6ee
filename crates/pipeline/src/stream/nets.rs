//! Opens the nets of a run from the models folder, according to the configuration.

use std::path::Path;

use roadplane_activity::ActivityNet;
use roadplane_detect::Detector;
use roadplane_infer::{ProviderChoice, Session, SessionOptions};
use roadplane_keypoints::KeypointNet;
use roadplane_write::ModelSummary;

use crate::{Config, PipelineError};

/// The nets of a run.
pub struct Nets {
    /// Detector of vehicles.
    pub detector: Detector,
    /// Net that finds the keypoints of vehicles.
    pub keypoints: KeypointNet,
    /// Net that labels the activities of tracks; `None` if activities are switched off.
    pub activity: Option<ActivityNet>,
}

impl Nets {
    /// Loads all nets from the models folder.
    ///
    /// # Errors
    /// Returns a [`PipelineError`] if a model cannot be used or ONNX Runtime is missing.
    pub fn open(models: &Path, config: &Config) -> Result<Self, PipelineError> {
        Ok(Self {
            detector: open_detector(models, config)?,
            keypoints: open_keypoints(models, config)?,
            activity: config.activity.enabled.then(|| open_activity(models, config)).transpose()?,
        })
    }

    /// Returns the names and versions of the nets, for the summary of a run.
    #[must_use]
    pub fn summaries(&self) -> Vec<ModelSummary> {
        self.sessions().map(summary_of).collect()
    }

    /// Returns one text per net: the hash of its weights, its execution provider and its calibration. A net with an
    /// equal text gives equal results.
    #[must_use]
    pub fn fingerprints(&self) -> Vec<String> {
        let of = |session: &Session| {
            let card = session.card();
            let calibration = serde_json::Value::Object(card.calibration.clone());
            format!("{} {} {calibration}", card.sha256, session.provider())
        };
        self.sessions().map(of).collect()
    }

    fn sessions(&self) -> impl Iterator<Item = &Session> {
        let of_pictures = [self.detector.session(), self.keypoints.session()];
        of_pictures.into_iter().chain(self.activity.as_ref().map(ActivityNet::session))
    }
}

/// Opens the detector, without the other nets.
///
/// # Errors
/// Returns a [`PipelineError`] if the model cannot be used or ONNX Runtime is missing.
pub fn open_detector(models: &Path, config: &Config) -> Result<Detector, PipelineError> {
    let session = Session::open(&models.join(&config.models.detector), &session_options(config))?;
    Ok(Detector::new(session, config.detect.clone())?)
}

/// Opens the keypoint net, without the other nets.
///
/// # Errors
/// Returns a [`PipelineError`] if the model cannot be used or ONNX Runtime is missing.
pub fn open_keypoints(models: &Path, config: &Config) -> Result<KeypointNet, PipelineError> {
    let card = models.join(&config.models.keypoints);
    Ok(KeypointNet::open(&card, &session_options(config), config.keypoints.clone())?)
}

/// Opens the activity net, without the other nets. This net is so small that the plain CPU provider runs it fastest.
///
/// # Errors
/// Returns a [`PipelineError`] if the model cannot be used or ONNX Runtime is missing.
pub fn open_activity(models: &Path, config: &Config) -> Result<ActivityNet, PipelineError> {
    let options = SessionOptions { provider: ProviderChoice::Cpu, threads: 1, library: None };
    Ok(ActivityNet::open(&models.join(&config.models.activity), &options)?)
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
