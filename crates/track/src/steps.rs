//! Steps of the tracker that can be switched off, to measure what each is worth.

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
