//! Converts frames to those of a camera at rest.
//!
//! Shake is removed, and camera moves are dated to their first frame. Vehicles are removed from pictures without
//! information.
//!
//! The watcher reports a move some time after it happened, together with its first frame (`watch.moved`). Therefore
//! frames wait for a few seconds, and the move is assigned to the right frame. Cars seen during a move are removed,
//! because no camera at rest observed them. Cars in unsettled frames at the end of a clip are removed too: the watcher
//! never decided about these frames.

use std::collections::VecDeque;

use nalgebra::Vector2;
use roadplane_base::{FrameRecord, LeftOut, MoveKind, PictureVerdict, WatchRecord, bbox_moved};

/// Time that frames wait, s; longer than the watcher needs to report a move.
const LAG_S: f64 = 8.0;

/// An iterator over frames in the order of time that removes shake and dates camera moves; see the module.
pub struct AtRest<I> {
    /// Source of the frames.
    frames: I,
    /// Frames that wait, in the order of time.
    held_back: VecDeque<FrameRecord>,
    /// Whether the source has ended.
    is_over: bool,
    /// Whether the camera is moving at the current frame.
    is_moving: bool,
}

impl<I> AtRest<I> {
    /// Creates the iterator over `frames`.
    pub fn new(frames: I) -> Self {
        Self { frames, held_back: VecDeque::new(), is_over: false, is_moving: false }
    }
}

impl<I, E> Iterator for AtRest<I>
where
    I: Iterator<Item = Result<FrameRecord, E>>,
{
    type Item = Result<FrameRecord, E>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_over {
            let waited_s = match (self.held_back.front(), self.held_back.back()) {
                (Some(first), Some(last)) => last.time_s - first.time_s,
                _ => 0.0,
            };
            if waited_s > LAG_S {
                break;
            }
            match self.frames.next() {
                Some(Ok(frame)) => self.take(frame),
                Some(Err(error)) => return Some(Err(error)),
                None => {
                    self.is_over = true;
                    self.leave_out_the_unsettled_end();
                }
            }
        }
        let mut frame = self.held_back.pop_front()?;
        if let Some(moved) = frame.watch.as_ref().and_then(|watch| watch.moved) {
            self.is_moving = moved.kind == MoveKind::Moving;
        }
        let shows_no_rest = frame
            .watch
            .as_ref()
            .is_some_and(|watch| watch.verdict.is_blind() || watch.verdict == PictureVerdict::Moving);
        if self.is_moving || shows_no_rest {
            leave_out_vehicles(&mut frame);
        }
        if let Some(watch) = &mut frame.watch
            && !watch.verdict.is_blind()
            && (self.is_moving || watch.verdict == PictureVerdict::Moving)
        {
            watch.left_out = LeftOut::Moved;
        }
        settle(&mut frame);
        Some(Ok(frame))
    }
}

impl<I> AtRest<I> {
    /// Adds a frame to those that wait, and assigns a reported move to its first frame.
    fn take(&mut self, mut frame: FrameRecord) {
        let moved = frame.watch.as_mut().and_then(|watch| watch.moved.take());
        self.held_back.push_back(frame);
        let Some(moved) = moved else { return };
        let since = self.held_back.iter().position(|frame| frame.frame >= moved.since_frame).unwrap_or(0);
        let known = self.held_back.len().saturating_sub(since + 1);
        let here = self.held_back.iter_mut().skip(since).filter_map(|frame| frame.watch.as_mut());
        for (i, watch) in here.enumerate() {
            if i == 0 {
                watch.moved = Some(moved);
            }
            // This offset refers to the previous camera position. Offsets refer to the new position only from the frame
            // of the report.
            if i < known {
                watch.offset_px = [0.0; 2];
            }
            watch.verdict = match (moved.kind, watch.verdict) {
                (MoveKind::Moving, PictureVerdict::Unsettled) => PictureVerdict::Moving,
                (
                    MoveKind::Turned | MoveKind::Zoomed | MoveKind::Cut,
                    PictureVerdict::Unsettled | PictureVerdict::Moving,
                ) => PictureVerdict::Rest,
                (_, verdict) => verdict,
            };
        }
    }

    /// Removes the vehicles of unsettled frames at the end of the clip.
    fn leave_out_the_unsettled_end(&mut self) {
        let unsettled = |frame: &FrameRecord| {
            frame.watch.as_ref().is_some_and(|w| w.verdict == PictureVerdict::Unsettled)
        };
        for frame in self.held_back.iter_mut().rev().take_while(|frame| unsettled(frame)) {
            leave_out_vehicles(frame);
            frame.watch.iter_mut().for_each(|watch| watch.left_out = LeftOut::MayHaveMoved);
        }
    }
}

/// Removes all vehicles of a frame.
fn leave_out_vehicles(frame: &mut FrameRecord) {
    frame.cars.clear();
    frame.weak.clear();
}

/// Removes the shake from boxes and keypoints.
fn settle(frame: &mut FrameRecord) {
    let offset = frame.watch.as_ref().map_or(Vector2::zeros(), WatchRecord::offset);
    if offset.norm() < f64::EPSILON {
        return;
    }
    for car in &mut frame.cars {
        car.bbox_px = bbox_moved(&car.bbox_px, &-offset);
        for point in car.keypoints.iter_mut().flat_map(|set| set.iter_mut().flatten()) {
            point.pixel -= offset;
        }
    }
    for weak in &mut frame.weak {
        weak.bbox_px = bbox_moved(&weak.bbox_px, &-offset);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{CameraMove, CarRecord, ImageSize, WeakBox};

    /// Returns a frame every 0.1 s with one car, one weak box and a verdict of the watcher.
    fn frame(index: u64, verdict: PictureVerdict) -> FrameRecord {
        let watch = Some(WatchRecord { looked: true, verdict, ..WatchRecord::default() });
        let cars = vec![CarRecord::boxed([10.0, 10.0, 50.0, 40.0])];
        let size = ImageSize { width: 640, height: 360 };
        let weak = vec![WeakBox { bbox_px: [60.0, 10.0, 90.0, 40.0], score: 0.2 }];
        FrameRecord { watch, cars, weak, ..FrameRecord::empty(index, index as f64 * 0.1, size) }
    }

    /// Returns a frame in which the watcher reports a move since frame `since_frame`.
    fn moved(index: u64, kind: MoveKind, since_frame: u64) -> FrameRecord {
        let mut frame = frame(index, PictureVerdict::Rest);
        let since_s = since_frame as f64 * 0.1;
        if let Some(watch) = &mut frame.watch {
            watch.moved = Some(CameraMove { kind, since_frame, since_s, shift_px: None, log_scale: None });
        }
        frame
    }

    /// Returns the frames after the conversion.
    fn settled(frames: Vec<FrameRecord>) -> Vec<FrameRecord> {
        AtRest::new(frames.into_iter().map(Ok::<_, ()>)).map(Result::unwrap).collect()
    }

    #[test]
    fn a_move_is_put_where_it_happened() {
        let mut frames: Vec<FrameRecord> = (0..200).map(|i| frame(i, PictureVerdict::Rest)).collect();
        frames[112] = moved(112, MoveKind::Turned, 100);
        // Until the report, the watcher takes the shift for shake.
        for shaken in &mut frames[98..103] {
            shaken.watch.as_mut().unwrap().offset_px = [8.0, 0.0];
        }
        let out = settled(frames);
        for (i, left) in [(97, 10.0), (99, 2.0), (100, 10.0), (102, 10.0), (112, 10.0)] {
            assert_eq!(out[i].cars[0].bbox_px[0], left, "frame {i}");
        }
        let moves: Vec<u64> =
            out.iter().filter(|f| f.watch.as_ref().unwrap().moved.is_some()).map(|f| f.frame).collect();
        assert_eq!(moves, [100]);
        assert_eq!(out.iter().map(|f| f.frame).collect::<Vec<_>>(), (0..200).collect::<Vec<_>>());
        assert!(out.iter().all(|f| f.cars.len() == 1));
    }

    #[test]
    fn cars_seen_in_motion_or_at_an_unsettled_end_are_left_out() {
        let mut frames: Vec<FrameRecord> = (0..200).map(|i| frame(i, PictureVerdict::Rest)).collect();
        frames[65] = moved(65, MoveKind::Moving, 50);
        frames[120] = moved(120, MoveKind::Turned, 110);
        for unsettled in (150..153).chain(195..200) {
            frames[unsettled] = frame(unsettled as u64, PictureVerdict::Unsettled);
        }
        let empty: Vec<u64> =
            settled(frames.clone()).iter().filter(|f| f.cars.is_empty()).map(|f| f.frame).collect();
        assert_eq!(empty, (50..110).chain(195..200).collect::<Vec<_>>());
        let marked = |why: LeftOut| -> Vec<u64> {
            let is_so = |f: &&FrameRecord| f.watch.as_ref().is_some_and(|watch| watch.left_out == why);
            settled(frames.clone()).iter().filter(is_so).map(|f| f.frame).collect()
        };
        assert_eq!(marked(LeftOut::Moved), (50..110).collect::<Vec<_>>());
        assert_eq!(marked(LeftOut::MayHaveMoved), (195..200).collect::<Vec<_>>());
        assert!(settled(frames).iter().all(|f| f.weak.len() == f.cars.len()));
    }

    #[test]
    fn shake_is_taken_out() {
        let mut shaken = frame(0, PictureVerdict::Rest);
        shaken.watch.as_mut().unwrap().offset_px = [2.0, -1.0];
        let settled = settled(vec![shaken]);
        assert_eq!(settled[0].cars[0].bbox_px, [8.0, 11.0, 48.0, 41.0]);
        assert_eq!(settled[0].weak[0].bbox_px, [58.0, 11.0, 88.0, 41.0]);
    }
}
