//! Reports on the progress of a run.

/// Receives reports on the progress of a run. A run reports every frame, so these functions must be fast.
pub trait Progress: Sync {
    /// Starts a count of frames. `frames` is the total number of frames to count, or `None` if it is unknown.
    fn expect(&self, frames: Option<u64>);
    /// Counts one frame that has passed all stages.
    fn frame_done(&self);
    /// Starts the next part of the work, which is called `name`.
    fn phase(&self, name: &str);
}

/// A receiver of progress reports that ignores all of them.
pub struct Silent;

impl Progress for Silent {
    fn expect(&self, _frames: Option<u64>) {}
    fn frame_done(&self) {}
    fn phase(&self, _name: &str) {}
}
