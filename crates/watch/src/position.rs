//! Decides from the motion of the pictures whether the camera is at rest.
//!
//! A camera at rest has a *position*: the pose of one of its pictures on the pictures of the place ([`Panorama`]). A
//! picture that is displaced from it starts a *suspicion*: the camera may have moved. This picture becomes the
//! *candidate* for the camera's new position. If the next pictures agree with the candidate for a second, it becomes the
//! new position. Otherwise a later picture replaces the candidate. If the pictures return to the old position, the
//! suspicion ends without a move.
//!
//! Therefore a shake, a flash, or a lorry that covers the whole picture is not reported as a move. A move is reported a
//! second after it happened, with the frame in which it happened.

use std::collections::VecDeque;

use nalgebra::Vector2;
use roadplane_base::{CameraMove, FrameStamp, MoveKind, PictureVerdict, median};

use crate::SmallGrey;
use crate::alignment::Alignment;
use crate::panorama::{Panorama, Pose};
use crate::registration::picture_box;

/// Smallest lasting displacement that counts as a camera move, px of the frame. The move starts with the first picture
/// that is displaced by more than half of this limit.
const MOVED_PX: f64 = 1.5;
/// Smallest lasting displacement that counts as a camera move, px of the reduced picture. The larger of this limit and
/// [`MOVED_PX`] applies.
const MOVED_SMALL_PX: f64 = 0.3;
/// Time over which the median displacement is computed, s. It is longer than half a swing of a camera pole.
const MEDIAN_S: f64 = 0.5;
/// Smallest number of pictures over which the median displacement is computed.
const MEDIAN_PICTURES: usize = 4;
/// Time for which the pictures must align with a new position before the position is accepted, s.
const HOLD_S: f64 = 1.0;
/// Smallest number of pictures that must align with a new position before the position is accepted.
const HOLD_PICTURES: usize = 4;
/// Largest drift of a new position before it is accepted, as a share of the smallest displacement that counts as a
/// move.
const CREEP: f64 = 0.35;
/// Time since the first displaced picture after which the camera counts as moving, s. This limit applies only if later
/// pictures did not align with the first candidate for a new position.
const MOTION_S: f64 = 1.5;
/// Time since the first displaced picture after which the camera counts as moving in any case, s.
const LONG_MOTION_S: f64 = 4.0;
/// A move is called a zoom if the absolute logarithm of its scale factor exceeds this value.
const ZOOM: f64 = 0.01;
/// Largest number of pictures over which the mean position of a shaken camera is averaged; they span about 20 s.
const AVERAGED: f64 = 180.0;

/// A picture and its displacement from a pose.
#[derive(Clone, Copy, Debug)]
struct Placed {
    stamp: FrameStamp,
    /// Displacement of the picture; `None` if it lies on no picture of the same place.
    alignment: Option<Alignment>,
    /// Root mean square displacement, px of the reduced picture; infinite without an alignment.
    displacement: f64,
}

/// A pose that the camera may have moved to.
#[derive(Clone, Debug)]
struct Candidate {
    /// Pose of the first picture; `None` if it lies on no picture of the place.
    pose: Option<Pose>,
    since: FrameStamp,
    pictures: Vec<Placed>,
}

#[derive(Clone, Debug)]
struct Suspicion {
    since: FrameStamp,
    candidate: Candidate,
    /// Number of candidates that were dropped because later pictures did not agree with them.
    abandoned: u32,
    /// Whether the motion of the camera was already reported.
    is_motion: bool,
}

/// The state of the camera at one picture.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CameraState {
    pub verdict: PictureVerdict,
    /// Camera move that was found at this picture.
    pub moved: Option<CameraMove>,
    /// Shift of the picture from the mean position of a shaken camera, px of the reduced picture.
    pub shift: Vector2<f64>,
}

/// The position of a camera, and the displacements of the last pictures from it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Position {
    /// Pose of the camera's position; `None` before the first picture with structure.
    pose: Option<Pose>,
    /// The last pictures.
    recent: VecDeque<Placed>,
    /// Middle of the camera's shake: the mean shift of the pictures, px of the reduced picture.
    origin: Vector2<f64>,
    /// Number of pictures in the mean shift `origin`, at most [`AVERAGED`].
    averaged: f64,
    suspicion: Option<Suspicion>,
}

/// The pictures of the place, and the size of a picture.
#[derive(Clone, Copy)]
struct Place<'a> {
    panorama: &'a Panorama,
    small: &'a SmallGrey,
}

impl Position {
    /// Determines the state of the camera at the picture that `panorama` has just registered.
    pub(crate) fn settle(
        &mut self,
        stamp: FrameStamp,
        panorama: &Panorama,
        small: &SmallGrey,
    ) -> CameraState {
        let pose = panorama.pose();
        let Some(own) = self.pose.or(pose) else {
            return CameraState { verdict: PictureVerdict::Unknown, ..CameraState::default() };
        };
        self.pose = Some(own);
        let place = Place { panorama, small };
        let placed = place.placed(stamp, Some(&own), pose.as_ref(), self.origin);
        self.recent.push_back(placed);
        let since_s = stamp.time_s() - MEDIAN_S;
        while self.recent.len() > MEDIAN_PICTURES
            && self.recent.front().is_some_and(|l| l.stamp.time_s() < since_s)
        {
            self.recent.pop_front();
        }
        let (verdict, moved) = self.judged(placed, pose, place);
        // An unsettled picture may be part of a slow swing. Its shift is therefore used until a move is reported.
        let shift = match self.recent.back().and_then(|last| last.alignment) {
            Some(alignment) if matches!(verdict, PictureVerdict::Rest | PictureVerdict::Unsettled) => {
                alignment.shift - self.origin
            }
            _ => Vector2::zeros(),
        };
        CameraState { verdict, moved, shift }
    }

    /// Whether the last picture shows the place of the camera's position.
    pub(crate) fn is_shown(&self, panorama: &Panorama) -> bool {
        let here = self.pose.zip(panorama.pose());
        here.is_some_and(|(own, pose)| panorama.between(&own, &pose).is_some())
    }

    /// Returns the verdict on the last picture, and the move that it shows.
    fn judged(
        &mut self,
        placed: Placed,
        pose: Option<Pose>,
        place: Place<'_>,
    ) -> (PictureVerdict, Option<CameraMove>) {
        let (stamp, moved) = (placed.stamp, place.least_move());
        let stays_away = stays_away(&self.recent, self.origin, moved);
        let Some(suspicion) = &mut self.suspicion else {
            if !stays_away {
                if let Some(alignment) = placed.alignment {
                    self.averaged = (self.averaged + 1.0).min(AVERAGED);
                    self.origin += (alignment.shift - self.origin) / self.averaged;
                }
                return (PictureVerdict::Rest, None);
            }
            // The suspicion starts with the first picture of the last unbroken run of displaced pictures.
            let off = |l: &&Placed| l.displacement > 0.5 * moved;
            let since = self.recent.iter().rev().take_while(off).last().map_or(stamp, |l| l.stamp);
            let candidate = place.candidate(pose, stamp, since);
            self.suspicion = Some(Suspicion { since, candidate, abandoned: 0, is_motion: false });
            return (PictureVerdict::Unsettled, None);
        };
        if !stays_away && !suspicion.is_motion && placed.displacement < moved {
            self.suspicion = None;
            return (PictureVerdict::Rest, None);
        }
        let candidate = &mut suspicion.candidate;
        candidate.pictures.push(place.placed(
            stamp,
            candidate.pose.as_ref(),
            pose.as_ref(),
            Vector2::zeros(),
        ));
        if candidate.is_abandoned(moved) {
            *candidate = place.candidate(pose, stamp, stamp);
            suspicion.abandoned += 1;
        } else if candidate.holds(stamp, moved) {
            let since = if suspicion.is_motion { candidate.since } else { suspicion.since };
            let found = place.described(self.pose.as_ref(), candidate, since);
            (self.origin, self.averaged) = (Vector2::zeros(), 0.0);
            if let Some(Suspicion { candidate, .. }) = self.suspicion.take() {
                self.pose = candidate.pose;
                self.recent = candidate.pictures.into();
            }
            return (PictureVerdict::Rest, Some(found));
        }
        let lasts_s = stamp.time_s() - suspicion.since.time_s();
        let moves = (suspicion.abandoned > 0 && lasts_s > MOTION_S) || lasts_s > LONG_MOTION_S;
        let begins = !suspicion.is_motion && moves;
        suspicion.is_motion |= moves;
        let verdict = if suspicion.is_motion { PictureVerdict::Moving } else { PictureVerdict::Unsettled };
        let begun = CameraMove {
            kind: MoveKind::Moving,
            since_frame: suspicion.since.index,
            since_s: suspicion.since.time_s(),
            shift_px: None,
            log_scale: None,
        };
        (verdict, begins.then_some(begun))
    }
}

impl Place<'_> {
    /// Returns the smallest lasting displacement that counts as a camera move, px of the reduced picture.
    fn least_move(&self) -> f64 {
        (MOVED_PX / self.small.factor as f64).max(MOVED_SMALL_PX)
    }

    /// Returns the displacement from one pose to another; `None` if they belong to different places.
    fn alignment(&self, from: Option<&Pose>, to: Option<&Pose>) -> Option<Alignment> {
        let motion = self.panorama.between(from?, to?)?;
        let similarity = motion.similarity(&picture_box((self.small.width, self.small.height)));
        Some(Alignment::from_similarity(&similarity, &Vector2::zeros()))
    }

    /// Returns the displacement of a picture from a pose. It is measured from `origin`, the mean shift of earlier
    /// pictures.
    fn placed(
        &self,
        stamp: FrameStamp,
        from: Option<&Pose>,
        pose: Option<&Pose>,
        origin: Vector2<f64>,
    ) -> Placed {
        let alignment = self.alignment(from, pose);
        let centred = |a: Alignment| Alignment { shift: a.shift - origin, ..a };
        let displacement =
            alignment.map_or(f64::INFINITY, |a| centred(a).displacement(self.small.width, self.small.height));
        Placed { stamp, alignment, displacement }
    }

    fn candidate(&self, pose: Option<Pose>, stamp: FrameStamp, since: FrameStamp) -> Candidate {
        let own = self.placed(stamp, pose.as_ref(), pose.as_ref(), Vector2::zeros());
        Candidate { pose, since, pictures: vec![own] }
    }

    /// Describes the move of the camera from its old pose to a candidate.
    fn described(&self, old: Option<&Pose>, new: &Candidate, since: FrameStamp) -> CameraMove {
        let moved = self.alignment(old, new.pose.as_ref());
        let kind = match moved {
            None => MoveKind::Cut,
            Some(moved) if moved.log_scale.abs() > ZOOM => MoveKind::Zoomed,
            Some(_) => MoveKind::Turned,
        };
        // Adding zero turns a negative zero into zero.
        let rounded = |value: f64, digits: f64| (value * digits).round() / digits + 0.0;
        let factor = self.small.factor as f64;
        CameraMove {
            kind,
            since_frame: since.index,
            since_s: since.time_s(),
            shift_px: moved.map(|m| [m.shift.x, m.shift.y].map(|v| rounded(v * factor, 10.0))),
            log_scale: moved.map(|m| rounded(m.log_scale, 1e4)),
        }
    }
}

/// Whether the last pictures as a whole are displaced. This is so if most of them lie on no picture of the place, or if
/// their median displacement exceeds `moved` plus their scatter.
fn stays_away(recent: &VecDeque<Placed>, origin: Vector2<f64>, moved: f64) -> bool {
    let (Some(first), Some(last)) = (recent.front(), recent.back()) else { return false };
    if recent.len() < MEDIAN_PICTURES || last.stamp.time_s() - first.stamp.time_s() < 0.5 * MEDIAN_S {
        return false;
    }
    let alignments: Vec<&Alignment> = recent.iter().filter_map(|l| l.alignment.as_ref()).collect();
    if 2 * alignments.len() < recent.len() {
        return true;
    }
    let Some((shift, grown)) = middle(&alignments) else { return false };
    let scatter = median(&mut alignments.iter().map(|a| (a.shift - shift).norm()).collect::<Vec<_>>());
    (shift - origin).norm().hypot(grown) > moved + scatter.unwrap_or(0.0)
}

/// Returns the median shift, and the displacement by the median scale and roll at 100 px from the picture's middle.
fn middle(alignments: &[&Alignment]) -> Option<(Vector2<f64>, f64)> {
    let of =
        |value: fn(&Alignment) -> f64| median(&mut alignments.iter().map(|a| value(a)).collect::<Vec<_>>());
    let shift = Vector2::new(of(|a| a.shift.x)?, of(|a| a.shift.y)?);
    Some((shift, 100.0 * of(|a| a.log_scale)?.hypot(of(|a| a.roll)?)))
}

impl Candidate {
    /// Whether most of the last pictures are displaced against the candidate.
    fn is_abandoned(&self, moved: f64) -> bool {
        let last = &self.pictures[self.pictures.len().saturating_sub(MEDIAN_PICTURES)..];
        let away = |l: &&Placed| l.displacement > moved;
        last.len() >= 2 && 2 * last.iter().filter(away).count() > last.len()
    }

    /// Whether the pictures have agreed with the candidate for long enough and without drift.
    fn holds(&self, now: FrameStamp, moved: f64) -> bool {
        let Some(first) = self.pictures.first() else { return false };
        let age_s = now.time_s() - first.stamp.time_s();
        let is_registered = self.pictures.last().is_some_and(|last| last.alignment.is_some());
        if age_s < HOLD_S || self.pictures.len() < HOLD_PICTURES || !is_registered {
            return false;
        }
        let middle_of = |pictures: &[Placed]| {
            middle(&pictures.iter().filter_map(|l| l.alignment.as_ref()).collect::<Vec<_>>())
        };
        let (early, late) = self.pictures.split_at(self.pictures.len() / 2);
        match (middle_of(early), middle_of(late)) {
            (Some((a, r)), Some((b, s))) => (b - a).norm().hypot(s - r) < CREEP * moved,
            _ => false,
        }
    }
}
