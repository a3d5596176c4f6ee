//! Frames → windows of views, each from one camera position.

use nalgebra::Vector2;
use roadplane_base::{FrameRecord, MoveKind, PictureVerdict, WatchRecord};

use crate::{
    LinkerOptions, MoveDetector, MoveOptions, MoveState, SegmentStart, SelectOptions, View, ViewSelector,
    linker::Linker,
};

/// How windows are cut.
#[derive(Clone, Debug)]
pub struct EvidenceOptions {
    /// Length of a window, s.
    pub window_s: f64,
    /// See [`LinkerOptions`].
    pub linker: LinkerOptions,
    /// See [`MoveOptions`].
    pub moves: MoveOptions,
    /// See [`SelectOptions`].
    pub select: SelectOptions,
}

impl Default for EvidenceOptions {
    fn default() -> Self {
        Self {
            window_s: 30.0,
            linker: LinkerOptions::default(),
            moves: MoveOptions::default(),
            select: SelectOptions::default(),
        }
    }
}

/// Views of one stretch of time from one camera position.
#[derive(Clone, Debug)]
pub struct Window {
    /// First and last presentation time, s.
    pub span_s: [f64; 2],
    /// Frames in it.
    pub frames: usize,
    /// What goes into the joint solve, best first.
    pub views: Vec<View>,
    /// Counts camera positions from 0.
    pub segment: usize,
    /// How that camera position began.
    pub start: SegmentStart,
    /// Parked cars witnessed that the camera stayed where it was since the window before.
    pub steady: bool,
}

/// A window being filled.
struct Open {
    from_s: f64,
    to_s: f64,
    frames: usize,
    witnessed: usize,
}

/// Collects evidence, streaming: memory is bounded by the window's views, not by the clip's length.
pub struct EvidenceBuilder {
    options: EvidenceOptions,
    linker: Linker,
    detector: MoveDetector,
    selector: ViewSelector,
    /// Frames that may belong to the next camera position.
    pending: Vec<FrameRecord>,
    open: Option<Open>,
    segment: usize,
    start: SegmentStart,
    first_of_segment: bool,
}

/// What the picture says, as [`AtRest`](crate::AtRest) hands it on.
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

/// Frames held back at most, whatever a suspicion does.
const MAX_PENDING: usize = 64;

impl EvidenceBuilder {
    /// With these options.
    #[must_use]
    pub fn new(options: EvidenceOptions) -> Self {
        Self {
            linker: Linker::new(options.linker.clone()),
            detector: MoveDetector::new(options.moves.clone()),
            selector: ViewSelector::new(options.select.clone()),
            options,
            pending: Vec::new(),
            open: None,
            segment: 0,
            start: SegmentStart::Clip,
            first_of_segment: true,
        }
    }

    /// Takes the next frame, in the order of time; gives a window when one is complete.
    pub fn push(&mut self, frame: FrameRecord) -> Option<Window> {
        let verdict = match &frame.watch {
            // Where the picture speaks, cars have no vote.
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
                self.segment += 1;
                self.start = start;
                self.first_of_segment = true;
                self.settle(false);
                self.add(&frame, false);
                window
            }
            state => {
                let steady = matches!(state, MoveState::Steady { .. });
                self.settle(steady);
                let full =
                    self.open.as_ref().is_some_and(|o| frame.time_s - o.from_s >= self.options.window_s);
                let window = if full { self.close() } else { None };
                self.add(&frame, steady);
                window
            }
        }
    }

    /// The last window.
    pub fn finish(&mut self) -> Option<Window> {
        self.settle(false);
        self.close()
    }

    /// Adds the frames that were held back.
    fn settle(&mut self, steady: bool) {
        for frame in std::mem::take(&mut self.pending) {
            self.add(&frame, steady);
        }
    }

    fn add(&mut self, frame: &FrameRecord, steady: bool) {
        let links = self.linker.push(frame);
        self.selector.push(frame, &links);
        let time_s = frame.time_s;
        let open = self.open.get_or_insert(Open { from_s: time_s, to_s: time_s, frames: 0, witnessed: 0 });
        open.to_s = open.to_s.max(time_s);
        open.frames += 1;
        open.witnessed += usize::from(steady);
    }

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
