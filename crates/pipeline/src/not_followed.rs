//! Counts the frames in which vehicles were not followed, because of the motion of the camera.

use roadplane_base::{FrameRecord, NotFollowedReason};
use roadplane_write::{NotFollowedInterval, RunStatus, Summary};

/// Share of the frames above which a run counts as partly followed, 0–1.
const MUCH: f64 = 0.05;

/// Frames and time in which vehicles were not followed, because of the motion of the camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NotFollowed {
    /// Number of frames.
    pub frames: u64,
    /// Time, s. A frame lasts until the next frame.
    pub seconds: f64,
    /// Number of all frames of the clip.
    pub all_frames: u64,
    /// The intervals in the order of time.
    pub intervals: Vec<NotFollowedInterval>,
}

impl NotFollowed {
    /// Returns the share of the frames, 0–1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.frames as f64 / self.all_frames.max(1) as f64
    }

    /// Returns the status of a run. It is partly followed if the motion was not measured in many frames of an
    /// undamaged input.
    pub(crate) fn status(&self, is_damaged: bool) -> RunStatus {
        let is_much = self.frames as f64 > MUCH * self.all_frames as f64;
        match (is_damaged, is_much) {
            (true, _) => RunStatus::InputDamaged,
            (false, true) => RunStatus::PartlyFollowed,
            (false, false) => RunStatus::Complete,
        }
    }

    /// Returns the warning for the user; `None` if vehicles were followed in all frames.
    pub(crate) fn in_words(&self) -> Option<String> {
        let Self { frames, seconds, intervals, .. } = self;
        let is_reason = |reason| intervals.iter().any(|interval| interval.reason == reason);
        let why =
            match (is_reason(NotFollowedReason::Travelling), is_reason(NotFollowedReason::NotRegistered)) {
                (false, false) => return None,
                (true, false) => "the camera was carried along",
                (false, true) => "the motion of the camera could not be measured",
                (true, true) => "the camera was carried along, or its motion could not be measured",
            };
        let percent = 100.0 * self.share();
        Some(format!(
            "{why}: vehicles were not followed in {frames} frames ({seconds:.1} s, {percent:.1} % of all)"
        ))
    }

    /// Writes the counts into a summary.
    pub(crate) fn note(&self, summary: &mut Summary) {
        summary.counts.frames_not_followed = self.frames;
        summary.watch.not_followed_s = self.seconds;
        summary.watch.not_followed_share = self.share();
        summary.watch.not_followed.clone_from(&self.intervals);
    }
}

/// Counts the frames of a clip in the order of time.
#[derive(Clone, Debug, Default)]
pub(crate) struct FollowCount {
    sum: NotFollowed,
    /// Reason why the last frame's vehicles were left out, and time of that frame, s.
    last: Option<(f64, NotFollowedReason)>,
}

impl FollowCount {
    /// Adds the next frame, as `calibrate::OneCamera` returns it.
    pub(crate) fn add(&mut self, frame: &FrameRecord) {
        let time_s = frame.time_s;
        let now = frame.watch.as_ref().and_then(|watch| watch.left_out);
        if let Some((last_s, _)) = self.last {
            self.sum.seconds += time_s - last_s;
        }
        self.sum.all_frames += 1;
        if let Some(reason) = now {
            self.sum.frames += 1;
            match self.sum.intervals.last_mut() {
                Some(interval) if self.last.is_some_and(|(_, last)| last == reason) => interval.to_s = time_s,
                _ => self.sum.intervals.push(NotFollowedInterval { reason, from_s: time_s, to_s: time_s }),
            }
        }
        self.last = now.map(|reason| (time_s, reason));
    }

    /// Returns the sums.
    pub(crate) fn finish(self) -> NotFollowed {
        self.sum
    }
}

#[cfg(test)]
mod tests {
    use roadplane_base::{ImageSize, WatchRecord};

    use super::*;

    fn counted(frames: u64, is_left_out: impl Fn(u64) -> bool) -> NotFollowed {
        let mut count = FollowCount::default();
        for index in 0..frames {
            let size = ImageSize { width: 640, height: 360 };
            let left_out = is_left_out(index).then_some(NotFollowedReason::NotRegistered);
            let watch = Some(WatchRecord { left_out, ..WatchRecord::default() });
            count.add(&FrameRecord { watch, ..FrameRecord::empty(index, index as f64 * 0.1, size) });
        }
        count.finish()
    }

    #[test]
    fn frames_and_seconds_are_counted() {
        let sum = counted(100, |index| index >= 90);
        assert_eq!(sum.frames, 10);
        assert!((sum.seconds - 0.9).abs() < 1e-9 && (sum.share() - 0.1).abs() < 1e-9);
        assert_eq!(
            [false, true].map(|is_damaged| sum.status(is_damaged)),
            [RunStatus::PartlyFollowed, RunStatus::InputDamaged]
        );
        let words = sum.in_words().unwrap();
        assert!(
            words.contains("measured: vehicles were not followed in 10 frames (0.9 s, 10.0 % of all)"),
            "{words}"
        );
        let interval =
            NotFollowedInterval { reason: NotFollowedReason::NotRegistered, from_s: 9.0, to_s: 9.9 };
        assert_eq!(sum.intervals, [interval]);
        let few = counted(100, |index| index == 50);
        assert!(few.status(false) == RunStatus::Complete && few.in_words().is_some());
        assert_eq!(counted(100, |_| false).in_words(), None);
    }
}
