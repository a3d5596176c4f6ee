//! Cuts the frames of a clip into windows of views. All views of a window have the same camera position.

use nalgebra::Vector2;
use roadplane_base::FrameRecord;

use crate::{Fold, View, ViewSelector, ground::is_beyond, linker::Linker};

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
    pub position: usize,
}

impl Window {
    /// Divides the window of a site with a fold into two: the views on this side of the line, and those beyond it. The
    /// second one has the next index, although the camera is the same.
    ///
    /// `foot_px` gives the position of a box as in [`Fold`].
    #[must_use]
    pub fn divided(mut self, fold: &Fold, foot_px: impl Fn(&[f64; 4]) -> Vector2<f64>) -> [Self; 2] {
        let views = std::mem::take(&mut self.views).into_iter();
        let (beyond, here) = views.partition(|view| is_beyond(&fold.line, &foot_px(&view.bbox_px)));
        [(here, self.position), (beyond, self.position + 1)].map(|(views, position)| Self {
            views,
            position,
            ..self
        })
    }
}

/// Collects evidence frame by frame. Its memory is bounded by the window's views, not by the clip's length.
///
/// The camera positions are those of [`OneCamera`](crate::OneCamera). Frames without a record of the watcher belong to
/// the position before.
pub struct EvidenceBuilder {
    window_s: f64,
    linker: Linker,
    selector: ViewSelector,
    /// The current window, without its views; `None` before its first frame.
    open: Option<Window>,
    /// Index of the camera position of the last frame, from 0.
    pub position: usize,
}

impl EvidenceBuilder {
    /// Creates a builder of windows of `window_s` seconds.
    #[must_use]
    pub fn new(window_s: f64) -> Self {
        Self {
            linker: Linker::default(),
            selector: ViewSelector::default(),
            window_s,
            open: None,
            position: 0,
        }
    }

    /// Takes the next frame, in the order of time. Returns a window when one is complete.
    pub fn push(&mut self, frame: &FrameRecord) -> Option<Window> {
        let moved = frame.watch.as_ref().filter(|watch| watch.moved.is_some());
        let is_full = |open: &Window| frame.time_s - open.span_s[0] >= self.window_s;
        let window =
            if moved.is_some() || self.open.as_ref().is_some_and(is_full) { self.finish() } else { None };
        if let Some(watch) = moved {
            self.linker.reset();
            self.position = watch.place.unwrap_or(self.position + 1);
        }
        let links = self.linker.push(frame);
        self.selector.push(frame, &links);
        let first =
            Window { span_s: [frame.time_s; 2], frames: 0, views: Vec::new(), position: self.position };
        let open = self.open.get_or_insert(first);
        open.span_s[1] = open.span_s[1].max(frame.time_s);
        open.frames += 1;
        window
    }

    /// Ends the current window and returns it; `None` if it has no frame.
    pub fn finish(&mut self) -> Option<Window> {
        Some(Window { views: self.selector.take(), ..self.open.take()? })
    }
}
