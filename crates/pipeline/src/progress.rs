//! Who wants to know how far a run is.

/// Told by the run; must be cheap.
pub trait Progress: Sync {
    /// Frames are counted from here on: so many are due, if that is known.
    fn expect(&self, frames: Option<u64>);
    /// One more frame went through all streaming stages.
    fn frame_done(&self);
    /// Another part of the work begins.
    fn phase(&self, name: &str);
}

/// Nobody does.
pub struct Silent;

impl Progress for Silent {
    fn expect(&self, _frames: Option<u64>) {}
    fn frame_done(&self) {}
    fn phase(&self, _name: &str) {}
}
