//! The frames of a clip as the tracker stores them.

use std::collections::BTreeMap;

use roadplane_base::FrameStamp;

use crate::{BoxSighting, looks::Looks};

/// Boxes by the index of their frame.
pub(crate) type BoxesByFrame = BTreeMap<usize, Vec<BoxSighting>>;

/// The frames that a tracker was given, in the order of time.
#[derive(Default)]
pub(crate) struct Frames {
    /// Index and time of each frame.
    pub stamps: Vec<FrameStamp>,
    /// Time at which each picture was taken, since the first time stamp, s. So the time stamp at the start of a clip
    /// cannot change any digit.
    pub times_s: Vec<f64>,
    /// Whether each frame is an inference frame.
    pub looked: Vec<bool>,
}

impl Frames {
    /// Adds a frame that was taken `delay_s` after its time stamp. Returns its index and its time since the first time
    /// stamp, s.
    pub(crate) fn push(&mut self, stamp: FrameStamp, delay_s: f64, looked: bool) -> (usize, f64) {
        self.stamps.push(stamp);
        let time_s = self.since_first_s(stamp) + delay_s;
        self.times_s.push(time_s);
        self.looked.push(looked);
        (self.stamps.len() - 1, time_s)
    }

    /// Returns the time from the first time stamp to this one, s.
    pub(crate) fn since_first_s(&self, stamp: FrameStamp) -> f64 {
        stamp.pts_nanos.saturating_sub(self.stamps[0].pts_nanos) as f64 * 1e-9
    }

    /// Returns the number of inference frames that are far enough apart in time.
    pub(crate) fn looks(&self) -> usize {
        let looked = self.stamps.iter().zip(&self.looked).filter(|(_, looked)| **looked);
        Looks::of(looked.map(|(stamp, _)| self.since_first_s(*stamp))).count
    }
}
