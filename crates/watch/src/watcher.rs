//! Watches a clip picture by picture: blind pictures, the motion of the camera, and the verdict on each picture.
//!
//! At each full minute, new pictures of the place and a new position of the camera replace the old ones. They are built
//! up before it. So a run that starts at a full minute gives the same results as a run on the whole clip.

use roadplane_base::{FrameStamp, ImageSize, MoveKind, Registration, WatchRecord};

use crate::blind::Blindness;
use crate::panorama::Panorama;
use crate::position::{CameraState, Position};
use crate::reference::Prepared;
use crate::view::NOT_DISPLACED_PX;
use crate::{SmallGrey, View, WatchError};

/// Interval after which new pictures of the place replace the old ones, s. The intervals are counted from the start of
/// the input.
const MINUTE_S: f64 = 60.0;
/// Time for which new pictures of the place are built up before they replace the old ones, s. In this time, the mean
/// position of a shaken camera is averaged, and pictures are registered on both.
pub const RENEW_S: f64 = 20.0;

/// The watcher's result for one frame.
#[derive(Clone, Debug)]
pub struct Observation {
    /// The verdict, the offset by shake and any camera move, as written to the frame's record.
    pub record: WatchRecord,
    /// The reduced grey copy of the frame.
    pub small: SmallGrey,
    /// How the picture shows a keyframe of the place. `None` if it shows another place, or none. For a blind picture, it
    /// is that of the last picture before.
    pub view: Option<View>,
    /// Whether a new position of the camera was accepted in this frame. Earlier pictures then cannot be compared with
    /// later ones.
    pub is_new_position: bool,
}

/// The pictures of the place, and the position of the camera on them.
#[derive(Clone, Debug, Default)]
struct PlaceState {
    panorama: Panorama,
    position: Position,
}

impl PlaceState {
    /// Registers a picture, and determines the state of the camera.
    fn settle(
        &mut self,
        stamp: FrameStamp,
        small: &SmallGrey,
        picture: &Prepared,
    ) -> (Vec<Registration>, CameraState) {
        let motion = self.panorama.register(stamp, small, picture);
        (motion, self.position.settle(stamp, &self.panorama, small))
    }
}

/// Detects camera motion, shake and blind pictures in a clip, frame by frame.
#[derive(Clone, Debug, Default)]
pub struct Watcher {
    blindness: Blindness,
    now: PlaceState,
    /// The next minute's number, and the state that is prepared for it.
    next: Option<(u64, PlaceState)>,
    /// View of the last picture that was not blind.
    view: Option<View>,
    /// Whether a new minute has just begun.
    is_renewed: bool,
    /// A keyframe, and the earlier keyframe whose name it has in views.
    name: Option<(u64, u64)>,
    last: WatchRecord,
}

impl Watcher {
    /// Creates a watcher for a new clip.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the record of a frame that is not analysed. It repeats the last verdict and the last offset.
    #[must_use]
    pub fn unobserved(&self) -> WatchRecord {
        WatchRecord {
            looked: false,
            verdict: self.last.verdict,
            offset_px: self.last.offset_px,
            ..WatchRecord::default()
        }
    }

    /// Analyses the next frame. Frames must come in the order of time.
    ///
    /// # Errors
    /// [`WatchError`] when OpenCV fails.
    pub fn observe(&mut self, stamp: FrameStamp, image: &image::RgbImage) -> Result<Observation, WatchError> {
        let small = SmallGrey::of(image)?;
        let mut record = WatchRecord { looked: true, ..WatchRecord::default() };
        if let Some(verdict) = self.blindness.check(&small, stamp.time_s()) {
            record.verdict = verdict;
        } else {
            let (motion, state) = self.settle(stamp, &small, &Prepared::of(&small));
            (record.motion, record.verdict, record.moved) = (motion, state.verdict, state.moved);
            let offset = state.shift * small.factor as f64;
            if offset.norm() >= NOT_DISPLACED_PX {
                record.offset_px = [offset.x, offset.y].map(|v| (v * 100.0).round() / 100.0);
            }
            let size = ImageSize { width: image.width(), height: image.height() };
            let PlaceState { panorama, position } = &self.now;
            // A picture of another place may be a disturbance, until a move is accepted.
            let view = panorama.view(&record.motion, size);
            let view = view.filter(|view| view.keyframe.is_none() || position.is_shown(panorama));
            self.view = view.map(|view| self.renamed(view, stamp));
        }
        let is_new_position = record.moved.is_some_and(|moved| moved.kind != MoveKind::Moving);
        self.last = record.clone();
        Ok(Observation { record, small, view: self.view, is_new_position })
    }

    /// Keeps the name of the keyframe where a minute begins while the camera is at rest: the keyframe of the new minute
    /// shows the same.
    fn renamed(&mut self, mut view: View, stamp: FrameStamp) -> View {
        let is_at_rest = |view: &View| view.keyframe.is_some() && !view.is_displaced();
        let is_earlier = view.keyframe.is_some_and(|keyframe| keyframe < stamp.index);
        if std::mem::take(&mut self.is_renewed) && is_earlier && is_at_rest(&view) {
            let old = self.view.filter(is_at_rest).and_then(|old| old.keyframe);
            self.name = view.keyframe.zip(old);
        }
        if let Some((new, old)) = self.name
            && view.keyframe == Some(new)
        {
            view.keyframe = Some(old);
        }
        view
    }

    /// Registers a picture on the pictures of this minute and of the next.
    fn settle(
        &mut self,
        stamp: FrameStamp,
        small: &SmallGrey,
        picture: &Prepared,
    ) -> (Vec<Registration>, CameraState) {
        let minute = (stamp.time_s() / MINUTE_S).max(0.0) as u64;
        if let Some((_, next)) = self.next.take_if(|(from, _)| minute >= *from) {
            (self.now, self.is_renewed) = (next, true);
        }
        let (mut motion, state) = self.now.settle(stamp, small, picture);
        if stamp.time_s() - minute as f64 * MINUTE_S >= MINUTE_S - RENEW_S {
            let (_, next) = self.next.get_or_insert((minute + 1, PlaceState::default()));
            motion.extend(next.settle(stamp, small, picture).0);
        }
        (motion, state)
    }
}
