//! Steps of the tracker that can be switched off, to measure what each is worth.

/// Switches for the steps of the tracker; all steps are on by default.
///
/// `roadplane-lab eval tracker --layers` measures the effect of each step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrackSteps {
    /// Drops a new track that is not detected several times within its first inference frames (`tracker.rs`).
    pub confirm: bool,
    /// Merges two tracks of one vehicle, before linking and after it (`duplicates.rs`).
    pub merge: bool,
    /// Links tracklets over gaps (`link.rs`).
    pub link: bool,
    /// Cuts links that are probably wrong (`join.rs`).
    pub cut: bool,
    /// Leaves out tracks that are probably no vehicles (`existence.rs`).
    pub existence: bool,
    /// Makes tracklets of boxes that no tracklet has (`placed_boxes.rs`).
    pub boxes: bool,
    /// Estimates path and size together, where only boxes show a vehicle (`smooth_boxes.rs`).
    pub by_boxes: bool,
    /// Fits the cars again with the shape and the heading of their tracks, and tracks them again.
    pub second_pass: bool,
    /// Treats edges of boxes as uncertain where another vehicle begins.
    pub hidden_edges: bool,
    /// Leaves out tracks whose projected boxes do not match most of their detections.
    pub own_boxes: bool,
}

impl Default for TrackSteps {
    fn default() -> Self {
        Self {
            confirm: true,
            merge: true,
            link: true,
            cut: true,
            existence: true,
            boxes: true,
            by_boxes: true,
            second_pass: true,
            hidden_edges: true,
            own_boxes: true,
        }
    }
}
