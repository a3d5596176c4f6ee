//! Finds inference frames that repeat the picture before them.
//!
//! If the frame rate of a video is above that of its camera, pictures are repeated. A bad connection also repeats a picture
//! for a moment. All vehicles then seem to stop and to jump on. Such a frame is no evidence of motion.

use std::collections::VecDeque;

use roadplane_base::FrameRecord;

use crate::PipelineError;

/// Longest time between two different pictures, s. In less time, no traffic stops and drives on.
const MOST_S: f64 = 0.5;
/// Least ratio of the changes in the pictures around a repeated picture to its own change.
const QUIETER: f64 = 10.0;
/// Least share of a picture that can be seen to change: about one cell of the change map.
const LEAST_CHANGE: f64 = 1e-3;

/// Frames in the order of time, each with the answer whether it repeats the picture before it.
pub(crate) struct Repeats<I> {
    /// Source of the frames.
    frames: I,
    /// Frames that are read, but not returned yet.
    ahead: VecDeque<FrameRecord>,
    /// Time and change of the last inference frame that showed a new picture.
    last: Option<(f64, f64)>,
    /// Number of inference frames in `ahead` that are certainly repeats.
    repeats: usize,
    /// Error of the source, to be returned after the frames before it.
    error: Option<PipelineError>,
}

/// Returns the share of the picture that changed since the inference frame before, if this is one.
fn change(frame: &FrameRecord) -> Option<f64> {
    let watch = frame.watch.as_ref()?;
    watch.fresh.filter(|_| watch.looked)
}

impl<I: Iterator<Item = Result<FrameRecord, PipelineError>>> Repeats<I> {
    /// Creates the iterator over `frames`.
    pub(crate) fn new(frames: I) -> Self {
        Self { frames, ahead: VecDeque::new(), last: None, repeats: 0, error: None }
    }

    /// Reads on to the next new picture. Returns the number of inference frames before it, all of which are repeats.
    fn look_ahead(&mut self, (since_s, before): (f64, f64)) -> usize {
        let is_quieter = |change: f64, than: f64| change.max(LEAST_CHANGE) * QUIETER <= than;
        let (mut count, mut most, mut i) = (0, 0.0_f64, 0);
        if self.error.is_some() {
            return 0;
        }
        loop {
            if i == self.ahead.len() {
                match self.frames.next() {
                    Some(Ok(frame)) => self.ahead.push_back(frame),
                    Some(Err(error)) => {
                        self.error = Some(error);
                        return 0;
                    }
                    None => return 0,
                }
            }
            let frame = &self.ahead[i];
            i += 1;
            if frame.time_s - since_s > MOST_S {
                return 0;
            }
            let Some(change) = change(frame) else { continue };
            if !is_quieter(change, before) {
                return if is_quieter(most, change) { count } else { 0 };
            }
            (count, most) = (count + 1, most.max(change));
        }
    }
}

impl<I: Iterator<Item = Result<FrameRecord, PipelineError>>> Iterator for Repeats<I> {
    type Item = Result<(FrameRecord, bool), PipelineError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ahead.is_empty() {
            if let Some(error) = self.error.take() {
                return Some(Err(error));
            }
            match self.frames.next()? {
                Ok(frame) => self.ahead.push_back(frame),
                Err(error) => return Some(Err(error)),
            }
        }
        if self.repeats == 0
            && change(&self.ahead[0]).is_some()
            && let Some(last) = self.last
        {
            self.repeats = self.look_ahead(last);
        }
        let frame = self.ahead.pop_front()?;
        let Some(change) = change(&frame) else { return Some(Ok((frame, false))) };
        let repeats = self.repeats > 0;
        if repeats {
            self.repeats -= 1;
        } else {
            self.last = Some((frame.time_s, change));
        }
        Some(Ok((frame, repeats)))
    }
}

#[cfg(test)]
mod tests {
    use roadplane_base::{ImageSize, WatchRecord};

    use super::*;

    /// Returns which of these inference frames are repeats. Between two of them is a frame without inference.
    fn repeats(interval_s: f64, changes: &[f64]) -> Vec<bool> {
        let frame = |i: usize| {
            let looked = i.is_multiple_of(2);
            let fresh = looked.then(|| changes[i / 2]);
            let watch = WatchRecord { looked, fresh, ..WatchRecord::default() };
            let size = ImageSize { width: 640, height: 360 };
            let empty = FrameRecord::empty(i as u64, i as f64 * interval_s / 2.0, size);
            Ok(FrameRecord { watch: Some(watch), ..empty })
        };
        let found: Vec<(FrameRecord, bool)> =
            Repeats::new((0..2 * changes.len()).map(frame)).filter_map(Result::ok).collect();
        let numbers: Vec<u64> = found.iter().map(|(frame, _)| frame.frame).collect();
        assert_eq!(numbers, (0..2 * changes.len() as u64).collect::<Vec<u64>>(), "no frame is lost");
        found.into_iter().step_by(2).map(|(_, repeats)| repeats).collect()
    }

    #[test]
    fn pictures_that_stop_for_a_moment_are_repeats() {
        assert_eq!(repeats(0.1, &[1.0, 0.2, 0.001, 0.18, 0.2]), [false, false, true, false, false]);
        assert_eq!(repeats(0.1, &[1.0, 0.2, 0.0, 0.0, 0.4, 0.2]), [false, false, true, true, false, false]);
    }

    #[test]
    fn scenes_at_rest_have_no_repeats() {
        let none = |interval_s: f64, changes: &[f64]| assert!(!repeats(interval_s, changes).contains(&true));
        none(0.1, &[0.0008, 0.0, 0.0008, 0.0, 0.0008]); // noise
        none(0.1, &[0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2]); // longer than traffic can stop
        none(0.1, &[0.2, 0.03, 0.2, 0.1]); // fewer vehicles move
        none(0.1, &[0.2, 0.1, 0.0]); // the end of the clip
        none(1.0, &[0.2, 0.0, 0.2]); // pictures that are far apart
    }

    #[test]
    fn an_error_comes_after_the_frames_before_it() {
        let frame = |i: u64| {
            let watch = WatchRecord {
                looked: true,
                fresh: Some(if i == 1 { 0.2 } else { 0.0 }),
                ..Default::default()
            };
            let size = ImageSize { width: 640, height: 360 };
            FrameRecord { watch: Some(watch), ..FrameRecord::empty(i, i as f64 * 0.1, size) }
        };
        let source = [
            Ok(frame(0)),
            Ok(frame(1)),
            Ok(frame(2)),
            Err(PipelineError::Stopped { signal: 2 }),
            Ok(frame(4)),
        ];
        let found: Vec<Option<u64>> =
            Repeats::new(source.into_iter()).map(|one| one.ok().map(|(frame, _)| frame.frame)).collect();
        assert_eq!(found, [Some(0), Some(1), Some(2), None, Some(4)]);
    }
}
