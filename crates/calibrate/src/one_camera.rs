//! Converts the frames of a camera that turns and zooms to those of one camera at rest.
//!
//! The boxes, keypoints and covariances of each frame are converted to pixels of the world picture of its place (see
//! [`Places`]). For a camera that turns and zooms about its centre this is exact, whatever the distances. So the solver
//! and the tracker see one camera. Frames between two inference frames get an interpolated motion.
//!
//! Vehicles are removed from pictures that lie on no place. Such pictures come after a cut, from a view that is too short
//! for a place, or from a camera that is carried along. Vehicles are also removed from pictures without information.

use std::collections::VecDeque;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector2};
use roadplane_base::{
    CameraMove, FrameRecord, Homography, MoveKind, NotFollowedReason, PictureMotion, PictureVerdict,
};

use crate::places::{MIN_PLACE_S, Places};

/// The position of a picture in a place.
#[derive(Clone, Copy, Debug)]
struct Position {
    time_s: f64,
    place: usize,
    picture_from_world: PictureMotion,
}

/// An iterator over frames in the order of time that converts them to those of one camera; see the module.
pub struct OneCamera<I> {
    frames: I,
    places: Arc<Places>,
    /// Frames after the last inference frame, in the order of time.
    waiting: VecDeque<FrameRecord>,
    /// Converted frames, in the order of time.
    ready: VecDeque<FrameRecord>,
    is_over: bool,
    /// Position of the last picture whose position is known.
    last: Option<Position>,
    /// Reason why the vehicles of the last inference frame are not followed.
    lost: Option<NotFollowedReason>,
    /// Place of the last converted frame.
    place: usize,
}

impl<I> OneCamera<I> {
    /// Creates the iterator over `frames`, whose references lie at `places`.
    pub fn new(frames: I, places: Arc<Places>) -> Self {
        Self {
            frames,
            places,
            waiting: VecDeque::new(),
            ready: VecDeque::new(),
            is_over: false,
            last: None,
            lost: None,
            place: 0,
        }
    }

    /// Converts the waiting frames, and then the inference frame that ends the wait.
    fn convert(&mut self, inference: Option<FrameRecord>) {
        let before = self.last;
        let was_lost = self.lost;
        let now = inference.as_ref().and_then(|frame| self.position(frame));
        for frame in std::mem::take(&mut self.waiting) {
            let position = before.map(|before| match now {
                Some(now)
                    if now.place == before.place && now.time_s > before.time_s && self.lost.is_none() =>
                {
                    let share = (frame.time_s - before.time_s) / (now.time_s - before.time_s);
                    before.picture_from_world.between(&now.picture_from_world, share)
                }
                _ => before.picture_from_world,
            });
            let place = before.map_or(self.place, |before| before.place);
            self.emit(frame, place, position.unwrap_or(PictureMotion::IDENTITY), was_lost);
        }
        let Some(frame) = inference else { return };
        self.last = now.or(self.last);
        let (place, picture_from_world) =
            now.map_or((self.place, PictureMotion::IDENTITY), |now| (now.place, now.picture_from_world));
        self.emit(frame, place, picture_from_world, self.lost);
    }

    /// Returns the position of an inference frame; `None` if it is not known. A picture without structure keeps the last
    /// one.
    fn position(&mut self, frame: &FrameRecord) -> Option<Position> {
        let watch = frame.watch.as_ref()?;
        let time_s = frame.time_s;
        self.lost = None;
        for registration in &watch.motion {
            if let Some((place, picture_from_world)) = self.places.position(registration, frame.image_size_px)
            {
                return Some(Position { time_s, place, picture_from_world });
            }
        }
        // Files of older versions have the shake in place of the motion.
        if !self.places.is_measured {
            return Some(Position { time_s, place: 0, picture_from_world: shifted(watch.offset()) });
        }
        // A view without a place is elsewhere. A picture without any motion keeps the last position.
        let is_elsewhere = !watch.motion.is_empty()
            || matches!(watch.verdict, PictureVerdict::Unsettled | PictureVerdict::Moving);
        self.lost = if watch.motion.iter().any(|found| self.places.travelling.contains(&found.reference)) {
            Some(NotFollowedReason::Travelling)
        } else {
            is_elsewhere.then_some(NotFollowedReason::NotRegistered)
        };
        self.last.map(|last| Position { time_s, ..last })
    }

    /// Converts a frame and adds it to those that are ready.
    fn emit(
        &mut self,
        mut frame: FrameRecord,
        place: usize,
        picture_from_world: PictureMotion,
        lost: Option<NotFollowedReason>,
    ) {
        let is_lost = lost.is_some();
        let verdict = frame.watch.as_ref().map(|watch| watch.verdict);
        let is_blind = verdict.is_some_and(PictureVerdict::is_blind);
        if is_blind || is_lost || verdict == Some(PictureVerdict::Frozen) {
            frame.cars.clear();
            frame.weak.clear();
            frame.scene_lines = None;
        }
        let first_of_place = place != self.place && !is_lost;
        if first_of_place {
            self.place = place;
        }
        let (since_frame, since_s) = (frame.frame, frame.time_s);
        if let Some(watch) = &mut frame.watch {
            watch.left_out = lost.filter(|_| !is_blind);
            if self.places.is_measured {
                watch.place = Some(place);
                let cut =
                    CameraMove { kind: MoveKind::Cut, since_frame, since_s, shift_px: None, log_scale: None };
                watch.moved = first_of_place.then_some(cut);
            }
            if !picture_from_world.is_identity() {
                watch.picture_from_world = Some(picture_from_world);
            }
        }
        if !picture_from_world.is_identity() {
            to_world(&mut frame, &picture_from_world.inverse());
        }
        self.ready.push_back(frame);
    }
}

impl<I, E> Iterator for OneCamera<I>
where
    I: Iterator<Item = Result<FrameRecord, E>>,
{
    type Item = Result<FrameRecord, E>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(frame) = self.ready.pop_front() {
                return Some(Ok(frame));
            }
            if self.is_over {
                return None;
            }
            match self.frames.next() {
                Some(Ok(frame)) if frame.watch.as_ref().is_none_or(|watch| watch.looked) => {
                    self.convert(Some(frame));
                }
                Some(Ok(frame)) => {
                    self.waiting.push_back(frame);
                    let waited_s = |(first, last): (&FrameRecord, &FrameRecord)| last.time_s - first.time_s;
                    let ends = self.waiting.front().zip(self.waiting.back());
                    // Frames wait no longer than the shortest place lasts.
                    if ends.map_or(0.0, waited_s) > MIN_PLACE_S {
                        self.convert(None);
                    }
                }
                Some(Err(error)) => return Some(Err(error)),
                None => {
                    self.is_over = true;
                    self.convert(None);
                }
            }
        }
    }
}

/// Returns the mapping of a picture that is shifted, px.
fn shifted(by: Vector2<f64>) -> PictureMotion {
    Homography::new(Matrix3::new_translation(&by)).map_or(PictureMotion::IDENTITY, PictureMotion::from)
}

/// Converts the boxes, keypoints and lines of a frame to pixels of the world picture.
fn to_world(frame: &mut FrameRecord, world_from_picture: &PictureMotion) {
    for car in &mut frame.cars {
        car.bbox_px = world_from_picture.apply_to_box(&car.bbox_px);
        if let Some(keypoints) = &mut car.keypoints {
            world_from_picture.apply_to_keypoints(keypoints);
        }
    }
    for weak in &mut frame.weak {
        weak.bbox_px = world_from_picture.apply_to_box(&weak.bbox_px);
    }
    for line in frame.scene_lines.iter_mut().flatten() {
        line.ends_px = line.ends_px.map(|end| world_from_picture.apply(&end));
    }
}
