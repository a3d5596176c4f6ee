//! Cuts the frames of a clip into windows of views. All views of a window have the same camera position.

use nalgebra::Vector2;
use roadplane_base::{FrameRecord, MoveKind, PictureVerdict, WatchRecord};

use crate::{Fold, MoveDetector, MoveState, SegmentStart, View, ViewSelector, linker::Linker};

/// The views of one time interval from one camera position.
#[derive(Clone, Debug)]
pub struct Window {
    /// First and last presentation time of the window's frames, s.
    pub span_s: [f64; 2],
    /// Number of frames in the window.
    pub frames: usize,
    /// Views for the joint solve, best first.
    pub views: Vec<View>,
    /// Index of the camera position, from 0. Where the camera returns to a position, it has the same index again.
    pub segment: usize,
    /// How that camera position began.
    pub start: SegmentStart,
    /// Whether the picture or parked cars confirm that the camera did not move since the previous window.
    pub steady: bool,
}

impl Window {
    /// Divides the window of a site with a fold into two: the views on this side of the line, and those beyond it.
    ///
    /// `foot_px` gives the position of a box as in [`Fold`].
    #[must_use]
    pub fn divided(self, fold: &Fold, foot_px: impl Fn(&[f64; 4]) -> Vector2<f64>) -> [Self; 2] {
        let (beyond, here) = self.views.into_iter().partition(|view| fold.is_beyond(&foot_px(&view.bbox_px)));
        let Self { span_s, frames, segment, start, steady, .. } = self;
        [(here, segment, start), (beyond, segment + 1, SegmentStart::SecondPlane)]
            .map(|(views, segment, start)| Self { span_s, frames, views, segment, start, steady })
    }
}

/// A window that is being filled.
struct Open {
    /// Time of its first frame, s.
    from_s: f64,
    /// Time of its last frame, s.
    to_s: f64,
    /// Number of its frames.
    frames: usize,
    /// Number of frames that confirm a stationary camera.
    witnessed: usize,
}

/// Collects evidence frame by frame. Its memory is bounded by the window's views, not by the clip's length.
pub struct EvidenceBuilder {
    /// Length of a window, s.
    window_s: f64,
    /// Assigns boxes to cars.
    linker: Linker,
    /// Detects camera moves from parked cars.
    detector: MoveDetector,
    /// Selects the views of the current window.
    selector: ViewSelector,
    /// Frames that may belong to the next camera position; they wait for a verdict.
    pending: Vec<FrameRecord>,
    /// The current window; `None` before its first frame.
    open: Option<Open>,
    /// Index of the current camera position, from 0.
    segment: usize,
    /// How the current camera position began.
    start: SegmentStart,
    /// Whether the current window is the first of its camera position.
    first_of_segment: bool,
}

/// Converts the watcher's record, as [`OneCamera`](crate::OneCamera) passes it on, to a move state.
fn told(watch: &WatchRecord) -> MoveState {
    match watch.moved {
        Some(moved) => MoveState::Moved(match (moved.kind, moved.log_scale) {
            (MoveKind::Turned | MoveKind::Zoomed, Some(log_scale)) => SegmentStart::Moved { log_scale },
            _ => SegmentStart::Cut,
        }),
        None if watch.verdict == PictureVerdict::Rest => MoveState::Steady { shift_px: Vector2::zeros() },
        None => MoveState::Unknown,
    }
}

/// Largest number of frames that wait while a camera move is suspected.
const MAX_PENDING: usize = 64;

impl EvidenceBuilder {
    /// Creates a builder of windows of `window_s` seconds.
    #[must_use]
    pub fn new(window_s: f64) -> Self {
        Self {
            linker: Linker::default(),
            detector: MoveDetector::default(),
            selector: ViewSelector::default(),
            window_s,
            pending: Vec::new(),
            open: None,
            segment: 0,
            start: SegmentStart::Clip,
            first_of_segment: true,
        }
    }

    /// Takes the next frame, in the order of time. Returns a window when one is complete.
    pub fn push(&mut self, frame: FrameRecord) -> Option<Window> {
        let verdict = match &frame.watch {
            // The watcher's verdict from the picture has priority over the verdict from parked cars.
            Some(watch) => told(watch),
            None => self.detector.push(&frame),
        };
        match verdict {
            MoveState::Suspect if self.pending.len() < MAX_PENDING => {
                self.pending.push(frame);
                None
            }
            MoveState::Suspect => {
                self.settle(false);
                self.add(&frame, false);
                None
            }
            MoveState::Moved(start) => {
                let window = self.close();
                self.linker.reset();
                let place = frame.watch.as_ref().and_then(|watch| watch.place);
                self.segment = place.unwrap_or(self.segment + 1);
                self.start = start;
                self.first_of_segment = true;
                self.settle(false);
                self.add(&frame, false);
                window
            }
            state => {
                let steady = matches!(state, MoveState::Steady { .. });
                self.settle(steady);
                let full = self.open.as_ref().is_some_and(|o| frame.time_s - o.from_s >= self.window_s);
                let window = if full { self.close() } else { None };
                self.add(&frame, steady);
                window
            }
        }
    }

    /// Ends the clip and returns its last window.
    pub fn finish(&mut self) -> Option<Window> {
        self.settle(false);
        self.close()
    }

    /// Adds the waiting frames to the current window. `steady`: whether they confirm a stationary camera.
    fn settle(&mut self, steady: bool) {
        for frame in std::mem::take(&mut self.pending) {
            self.add(&frame, steady);
        }
    }

    /// Adds a frame to the current window. `steady`: whether it confirms a stationary camera.
    fn add(&mut self, frame: &FrameRecord, steady: bool) {
        let links = self.linker.push(frame);
        self.selector.push(frame, &links);
        let time_s = frame.time_s;
        let open = self.open.get_or_insert(Open { from_s: time_s, to_s: time_s, frames: 0, witnessed: 0 });
        open.to_s = open.to_s.max(time_s);
        open.frames += 1;
        open.witnessed += usize::from(steady);
    }

    /// Ends the current window and returns it; `None` if it has no frame.
    fn close(&mut self) -> Option<Window> {
        let open = self.open.take()?;
        let steady = !self.first_of_segment && 2 * open.witnessed >= open.frames;
        self.first_of_segment = false;
        Some(Window {
            span_s: [open.from_s, open.to_s],
            frames: open.frames,
            views: self.selector.take(),
            segment: self.segment,
            start: self.start,
            steady,
        })
    }
}
