//! The background pictures of a clip: of the keyframe in view, and of the keyframe before.

use image::RgbImage;
use roadplane_watch::{Background, Cells, EmptyScene, View};

/// The background of the keyframe in view, and an earlier one while that is more complete.
///
/// A camera that sways gets a new keyframe at each full minute, and one that pans gets many. The background of a new
/// keyframe begins with all vehicles of its first picture.
#[derive(Debug, Default)]
pub(crate) struct Backgrounds {
    current: Option<Background>,
    earlier: Option<Background>,
}

impl Backgrounds {
    /// Blends the next picture into the background of the keyframe that it shows, and returns this background. `busy`
    /// has the cells with a change or a vehicle. After a move of the camera (`is_new_position`), all backgrounds begin
    /// anew.
    pub(crate) fn take(
        &mut self,
        image: &RgbImage,
        view: &View,
        busy: &Cells,
        is_new_position: bool,
        time_s: f64,
    ) -> &Background {
        if is_new_position {
            *self = Self::default();
        }
        let is_shown = |background: &Background| background.keyframe() == view.keyframe;
        if !self.current.as_ref().is_some_and(is_shown) {
            std::mem::swap(&mut self.current, &mut self.earlier);
            // The more complete one of those that are not in view is kept.
            if !self.current.as_ref().is_some_and(is_shown)
                && let Some(other) = self.current.take()
                && self.earlier.as_ref().is_none_or(|kept| kept.bare_count() < other.bare_count())
            {
                self.earlier = Some(other);
            }
        }
        let current = self.current.get_or_insert_with(|| Background::new(image, view, busy.emptied()));
        current.take(image, view, busy, time_s);
        current
    }

    /// Returns the most complete background.
    pub(crate) fn best(&self) -> Option<&Background> {
        let more = |earlier: &&Background| {
            self.current.as_ref().is_none_or(|current| earlier.bare_count() > current.bare_count())
        };
        self.earlier.as_ref().filter(more).or(self.current.as_ref())
    }

    /// Returns the most complete picture of the empty scene.
    pub(crate) fn empty_scene(&self) -> Option<EmptyScene> {
        self.best().map(Background::empty_scene)
    }
}
