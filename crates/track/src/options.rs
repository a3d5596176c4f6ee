//! The settings of a tracker.

use serde::{Deserialize, Serialize};

use crate::TrackStep;

/// The settings of a tracker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackOptions {
    /// Least number of detections of a track. If half of the clip's inference frames are fewer, that half is enough.
    pub min_observed: usize,
    /// Least probability that a track is a vehicle, 0–1. Other tracks are dropped.
    pub min_exists_p: f64,
    /// The step that is left out. It is no setting: only the laboratory leaves steps out.
    #[serde(skip)]
    pub without: Option<TrackStep>,
}

impl TrackOptions {
    /// Whether the tracker takes a step.
    #[must_use]
    pub fn takes(&self, step: TrackStep) -> bool {
        self.without != Some(step)
    }
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self { min_observed: 6, min_exists_p: 0.5, without: None }
    }
}
