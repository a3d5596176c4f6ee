//! The settings of a tracker, and its steps that can be switched off.

use serde::{Deserialize, Serialize};

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

/// A step of the tracker. `roadplane-lab eval tracker --layers` leaves out one at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackStep {
    /// Drops a new track that is not detected several times within its first inference frames (`tracker.rs`).
    Confirm,
    /// Merges two tracks of one vehicle, before linking and after it (`duplicates.rs`).
    Merge,
    /// Links tracklets over gaps (`link.rs`).
    Link,
    /// Cuts links that are probably wrong (`join.rs`).
    Cut,
    /// Leaves out tracks that are probably no vehicles (`existence.rs`).
    Existence,
    /// Makes tracklets of boxes that no tracklet has (`placed_boxes.rs`).
    Boxes,
    /// Estimates path and size together, where only boxes show a vehicle (`smooth_boxes.rs`).
    ByBoxes,
    /// Fits the cars again with the shape and the heading of their tracks, and tracks them again.
    SecondPass,
    /// Compares the colours of boxes (`colour.rs`).
    Colours,
    /// Treats edges of boxes as uncertain where another vehicle begins.
    HiddenEdges,
    /// Leaves out tracks whose projected boxes do not match most of their detections.
    OwnBoxes,
}
