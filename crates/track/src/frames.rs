//! The frames of a clip as the tracker stores them.

use std::collections::BTreeMap;

use roadplane_base::FrameStamp;

use crate::Detection;

/// Least time between two inference frames that both count, s. A closer one adds nothing: the detector repeats its
/// misses and false alarms.
const APART_S: f64 = 0.075;

/// Boxes by the index of their frame.
pub(crate) type BoxesByFrame = BTreeMap<usize, Vec<Detection>>;

/// The frames that a tracker was given, in the order of time.
#[derive(Default)]
pub(crate) struct Frames {
    /// Index and time of each frame.
    pub stamps: Vec<FrameStamp>,
    /// Time at which each picture was taken, since the first time stamp, s. Thus the first time stamp has no
    /// effect on the digits.
    pub times_s: Vec<f64>,
    /// Whether each frame is an inference frame.
    pub is_inferred: Vec<bool>,
    /// Number of inference frames that are far enough apart in time ([`APART_S`]).
    pub counted: usize,
    /// Time of the last of these inference frames, s.
    last_counted_s: Option<f64>,
}

impl Frames {
    /// Adds a frame that was taken `delay_s` after its time stamp. `is_inferred` says whether it is an inference frame.
    /// Returns its index, its time since the first time stamp (s), and whether it is counted.
    pub(crate) fn push(&mut self, stamp: FrameStamp, delay_s: f64, is_inferred: bool) -> (usize, f64, bool) {
        self.stamps.push(stamp);
        let stamped_s = stamp.pts_nanos.saturating_sub(self.stamps[0].pts_nanos) as f64 * 1e-9;
        self.times_s.push(stamped_s + delay_s);
        self.is_inferred.push(is_inferred);
        let is_counted =
            is_inferred && self.last_counted_s.is_none_or(|last_s| stamped_s - last_s >= APART_S);
        if is_counted {
            (self.counted, self.last_counted_s) = (self.counted + 1, Some(stamped_s));
        }
        (self.stamps.len() - 1, stamped_s + delay_s, is_counted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inference_frames_count_about_ten_times_a_second_at_most() {
        let counted = |fps: u32| {
            let mut frames = Frames::default();
            for i in 0..10 * fps {
                let pts_nanos = i64::from(i) * 1_000_000_000 / i64::from(fps);
                frames.push(FrameStamp { index: u64::from(i), pts_nanos }, 0.0, true);
            }
            frames.counted
        };
        assert_eq!([10, 12, 5, 30, 25].map(counted), [100, 120, 50, 100, 125]);
    }
}
