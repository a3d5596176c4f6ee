//! Counts the frames in which vehicles were not followed, because the camera moved.

use roadplane_base::FrameRecord;

/// Share of the frames above which a run counts as partly followed, 0–1.
const MUCH: f64 = 0.05;

/// Frames and time in which vehicles were not followed, because the camera moved.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NotFollowed {
    /// Number of frames.
    pub frames: u64,
    /// Time, s. A frame lasts until the next frame.
    pub seconds: f64,
    /// Share of all frames, 0–1.
    pub share: f64,
}

impl NotFollowed {
    /// Whether so many frames were not followed that the run counts as partly followed.
    pub(crate) fn is_much(&self) -> bool {
        self.share > MUCH
    }

    /// Returns the warning for the user; `None` if vehicles were followed in all frames.
    pub(crate) fn in_words(&self) -> Option<String> {
        let Self { frames, seconds, share } = self;
        let percent = 100.0 * share;
        (*frames > 0).then(|| {
            format!(
                "the camera moved: vehicles were not followed in {frames} frames ({seconds:.1} s, {percent:.1} % of all)"
            )
        })
    }
}

/// Counts the frames of a clip in the order of time.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FollowCount {
    sum: NotFollowed,
    all_frames: u64,
    /// Time of the last frame, s, and whether its vehicles could be followed.
    last: Option<(f64, bool)>,
}

impl FollowCount {
    /// Adds the next frame, as `calibrate::AtRest` returns it. The time of a frame lasts until the next frame.
    pub(crate) fn add(&mut self, frame: &FrameRecord) {
        if let Some((time_s, false)) = self.last {
            self.sum.seconds += frame.time_s - time_s;
        }
        let is_followed = frame.watch.as_ref().is_none_or(|watch| !watch.not_followed);
        self.sum.frames += u64::from(!is_followed);
        self.all_frames += 1;
        self.sum.share = self.sum.frames as f64 / self.all_frames as f64;
        self.last = Some((frame.time_s, is_followed));
    }

    /// Returns the sums so far.
    pub(crate) fn sum(&self) -> NotFollowed {
        self.sum
    }
}

#[cfg(test)]
mod tests {
    use roadplane_base::{ImageSize, WatchRecord};

    use super::*;

    fn counted(frames: u64, followed: impl Fn(u64) -> bool) -> NotFollowed {
        let mut count = FollowCount::default();
        for index in 0..frames {
            let size = ImageSize { width: 640, height: 360 };
            let watch = Some(WatchRecord { not_followed: !followed(index), ..WatchRecord::default() });
            count.add(&FrameRecord { watch, ..FrameRecord::empty(index, index as f64 * 0.1, size) });
        }
        count.sum()
    }

    #[test]
    fn frames_and_seconds_are_counted() {
        let sum = counted(100, |index| index < 90);
        assert_eq!(sum.frames, 10);
        assert!((sum.seconds - 0.9).abs() < 1e-9 && (sum.share - 0.1).abs() < 1e-9);
        assert!(sum.is_much() && !counted(100, |index| index != 50).is_much());
        assert!(sum.in_words().unwrap().contains("10 frames (0.9 s, 10.0 % of all)"));
        assert_eq!(counted(100, |_| true).in_words(), None);
    }
}
