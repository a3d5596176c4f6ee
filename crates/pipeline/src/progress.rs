//! Progress reports of a run.

/// Receiver of progress reports. A run calls it often, so its functions must be cheap.
pub trait Progress: Sync {
    /// Starts to count frames; `frames` is the number of frames to come, if it is known.
    fn expect(&self, frames: Option<u64>);
    /// Notes that a frame has passed all stages.
    fn frame_done(&self);
    /// Starts another part of the work.
    fn phase(&self, name: &str);
}

/// Receiver that ignores all reports.
pub struct Silent;

impl Progress for Silent {
    fn expect(&self, _frames: Option<u64>) {}
    fn frame_done(&self) {}
    fn phase(&self, _name: &str) {}
}
