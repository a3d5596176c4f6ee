//! Decides whether the camera is at rest.
//!
//! Each picture is aligned with the background ([`Alignment`]). A displaced picture starts a *suspicion*: the camera
//! may have moved. This picture becomes the *candidate* for the camera's new position. If the next pictures align with
//! the candidate for a second, it becomes the new position. Otherwise a later picture replaces the candidate. If the
//! pictures return to the old background, the suspicion ends without a move.
//!
//! Therefore a shake, a flash, or a lorry that covers the whole picture is not reported as a move. A move is reported a
//! second after it happened, with the frame in which it happened.

use std::collections::VecDeque;

use nalgebra::Vector2;
use roadplane_base::{CameraMove, FrameStamp, MoveKind, PictureVerdict, Registration, WatchRecord, median};

use crate::alignment::Alignment;
use crate::blind::Blindness;
use crate::level::{BlockShift, Level};
use crate::panorama::Panorama;
use crate::reference::{Prepared, Reference};
use crate::search::{refined, search};
use crate::{SmallGrey, WatchError};

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
/// Smallest shake that is reported, px of the frame. A smaller shake is within the noise of boxes and keypoints.
const LEAST_OFFSET_PX: f64 = 0.5;
/// Largest number of pictures over which the mean position of a shaken camera is averaged; they span about 20 s.
const AVERAGED: f64 = 180.0;
/// Smallest number of blocks with structure that the background needs for a verdict.
const MIN_BLOCKS: usize = 8;

/// Interval after which a new background replaces the old one, s. The intervals are counted from the start of the
/// input.
const MINUTE_S: f64 = 60.0;
/// Time for which a new background is built up before it replaces the old one, s. In this time, the mean position of a
/// shaken camera is averaged.
pub const RENEW_S: f64 = 20.0;

/// The watcher's result for one frame.
#[derive(Clone, Debug)]
pub struct Observation {
    /// The verdict, the offset by shake and any camera move, as written to the frame's record.
    pub record: WatchRecord,
    /// The reduced grey copy of the frame.
    pub small: SmallGrey,
    /// Shift of the picture against the mean position of a camera at rest, px of the reduced picture.
    pub shift: Vector2<f64>,
    /// Whether a new position of the camera was accepted in this frame. Earlier pictures then cannot be compared with
    /// later ones.
    pub is_new_position: bool,
}

/// A picture and its alignment with a reference.
#[derive(Clone, Copy, Debug)]
struct AlignedPicture {
    stamp: FrameStamp,
    alignment: Option<Alignment>,
    /// Root mean square displacement, px of the reduced picture; infinite if the alignment fails.
    displacement: f64,
}

/// A position that the camera may have moved to.
#[derive(Clone, Debug)]
struct Candidate {
    reference: Reference,
    since: FrameStamp,
    pictures: Vec<AlignedPicture>,
}

#[derive(Clone, Debug)]
struct Suspicion {
    since: FrameStamp,
    candidate: Candidate,
    /// Number of candidates that were dropped because later pictures did not align with them.
    abandoned: u32,
    /// Whether the motion of the camera was already reported.
    is_motion: bool,
}

/// A position of the camera: the background that the camera shows there, and how the pictures align with this
/// background.
#[derive(Clone, Debug, Default)]
struct Position {
    reference: Option<Reference>,
    /// The last pictures and their alignment with the background.
    recent: VecDeque<AlignedPicture>,
    /// Middle of the camera's shake: the mean shift of the pictures against the background, px of the reduced picture.
    origin: Vector2<f64>,
    /// Number of pictures in the mean shift `origin`, at most [`AVERAGED`].
    averaged: f64,
    suspicion: Option<Suspicion>,
}

/// Detects camera motion, shake and blind pictures in a clip, frame by frame.
#[derive(Clone, Debug, Default)]
pub struct Watcher {
    blindness: Blindness,
    position: Position,
    /// The prepared position that will replace the current one, and the number of the minute from which this is
    /// allowed.
    next: Option<(u64, Position)>,
    panorama: Panorama,
    /// The panorama of the next minute, and its number. In the last [`RENEW_S`] seconds of a minute, pictures are
    /// registered on both. This links them.
    next_panorama: Option<(u64, Panorama)>,
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
        let blind = self.blindness.check(&small, stamp.time_s());
        let mut record = WatchRecord { looked: true, ..WatchRecord::default() };
        let mut shift = Vector2::zeros();
        let mut is_new_position = false;
        if let Some(verdict) = blind {
            record.verdict = verdict;
        } else {
            self.renew(stamp.time_s());
            let before = self.position.reference.is_some();
            let picture = Prepared::of(&small);
            record.motion = self.registered(stamp, &small, &picture);
            self.position.settle(stamp, &small, &picture, &mut record);
            if let Some((_, next)) = &mut self.next {
                next.settle(stamp, &small, &picture, &mut WatchRecord::default());
            }
            is_new_position = before && record.moved.is_some_and(|m| m.kind != MoveKind::Moving);
            // An unsettled picture may be part of a slow swing. Its shift is therefore used until a move is reported.
            if matches!(record.verdict, PictureVerdict::Rest | PictureVerdict::Unsettled)
                && let Some(alignment) = self.position.recent.back().and_then(|picture| picture.alignment)
            {
                shift = alignment.shift - self.position.origin;
                let offset = shift * small.factor as f64;
                if offset.norm() >= LEAST_OFFSET_PX {
                    record.offset_px = [offset.x, offset.y].map(|v| (v * 100.0).round() / 100.0);
                }
            }
        }
        self.last = record.clone();
        Ok(Observation { record, small, shift, is_new_position })
    }

    /// Registers a picture on the panoramas of this minute and of the next.
    fn registered(&mut self, stamp: FrameStamp, small: &SmallGrey, picture: &Prepared) -> Vec<Registration> {
        let minute = (stamp.time_s() / MINUTE_S).max(0.0) as u64;
        if let Some((_, next)) = self.next_panorama.take_if(|(from, _)| minute >= *from) {
            self.panorama = next;
        }
        let mut out = self.panorama.register(stamp, small, picture);
        if stamp.time_s() - minute as f64 * MINUTE_S >= MINUTE_S - RENEW_S {
            let (_, next) = self.next_panorama.get_or_insert((minute + 1, Panorama::default()));
            out.extend(next.register(stamp, small, picture));
        }
        out
    }

    /// Starts a new background before the current one is too old. The new one replaces the current one when neither of
    /// the two suspects a move.
    fn renew(&mut self, time_s: f64) {
        let minute = (time_s / MINUTE_S).max(0.0) as u64;
        if let Some((from, next)) = &mut self.next
            && minute >= *from
            && next.reference.is_some()
            && next.suspicion.is_none()
            && self.position.suspicion.is_none()
        {
            self.position = std::mem::take(next);
            self.next = None;
        }
        if self.next.is_none() && time_s - minute as f64 * MINUTE_S >= MINUTE_S - RENEW_S {
            self.next = Some((minute + 1, Position::default()));
        }
    }
}

impl Position {
    /// Determines the verdict on a picture that contains information, and writes it to `record`.
    fn settle(&mut self, stamp: FrameStamp, small: &SmallGrey, picture: &Prepared, record: &mut WatchRecord) {
        let moved = (MOVED_PX / small.factor as f64).max(MOVED_SMALL_PX);
        let reference = match &mut self.reference {
            Some(reference) if reference.fine().size() == (small.width, small.height) => reference,
            slot => slot.insert(Reference::new(picture)),
        };
        if reference.fine().block_count() < MIN_BLOCKS {
            // If the first picture has no structure (night, fog), a picture with structure everywhere replaces it. A
            // single car on a bare road is not enough.
            let fresh = Reference::new(picture);
            if fresh.fine().is_structured_all_over() {
                *reference = fresh;
            } else {
                let shifts = reference.measured(picture);
                reference.follow(picture, &shifts, stamp.time_s());
                record.verdict = PictureVerdict::Unknown;
                return;
            }
        }
        let shifts = reference.measured(picture);
        let aligned = align(reference, stamp, &shifts.fine, self.origin);
        self.recent.push_back(aligned);
        let since_s = stamp.time_s() - MEDIAN_S;
        while self.recent.len() > MEDIAN_PICTURES
            && self.recent.front().is_some_and(|l| l.stamp.time_s() < since_s)
        {
            self.recent.pop_front();
        }
        let stays_away = stays_away(&self.recent, self.origin, moved);
        match &mut self.suspicion {
            None if !stays_away => {
                record.verdict = PictureVerdict::Rest;
                if let Some(alignment) = aligned.alignment {
                    self.averaged = (self.averaged + 1.0).min(AVERAGED);
                    self.origin += (alignment.shift - self.origin) / self.averaged;
                    if (alignment.shift).norm() < moved {
                        reference.follow(picture, &shifts, stamp.time_s());
                    }
                }
            }
            None => {
                // The suspicion starts with the first picture of the last unbroken run of displaced pictures.
                let off = |l: &&AlignedPicture| l.displacement > 0.5 * moved;
                let since = self.recent.iter().rev().take_while(off).last().map_or(stamp, |l| l.stamp);
                let candidate = Candidate::new(picture, stamp, since);
                self.suspicion = Some(Suspicion { since, candidate, abandoned: 0, is_motion: false });
                record.verdict = PictureVerdict::Unsettled;
            }
            Some(suspicion) => {
                if !stays_away && !suspicion.is_motion && aligned.displacement < moved {
                    self.suspicion = None;
                    record.verdict = PictureVerdict::Rest;
                    return;
                }
                record.verdict =
                    if suspicion.is_motion { PictureVerdict::Moving } else { PictureVerdict::Unsettled };
                let candidate = &mut suspicion.candidate;
                let shifts = candidate.reference.measured(picture);
                candidate.pictures.push(align(&candidate.reference, stamp, &shifts.fine, Vector2::zeros()));
                if candidate.is_abandoned(moved) {
                    *candidate = Candidate::new(picture, stamp, stamp);
                    suspicion.abandoned += 1;
                } else if candidate.holds(stamp, moved) {
                    let since = if suspicion.is_motion { candidate.since } else { suspicion.since };
                    record.moved = Some(described(reference.fine(), candidate, since, small.factor));
                    record.verdict = PictureVerdict::Rest;
                    (self.origin, self.averaged) = (Vector2::zeros(), 0.0);
                    if let Some(Suspicion { candidate, .. }) = self.suspicion.take() {
                        self.reference = Some(candidate.reference);
                        self.recent = candidate.pictures.into();
                    }
                    return;
                }
                let lasts_s = stamp.time_s() - suspicion.since.time_s();
                let moves = (suspicion.abandoned > 0 && lasts_s > MOTION_S) || lasts_s > LONG_MOTION_S;
                if !suspicion.is_motion && moves {
                    suspicion.is_motion = true;
                    record.verdict = PictureVerdict::Moving;
                    record.moved = Some(CameraMove {
                        kind: MoveKind::Moving,
                        since_frame: suspicion.since.index,
                        since_s: suspicion.since.time_s(),
                        shift_px: None,
                        log_scale: None,
                    });
                }
            }
        }
    }
}

/// Aligns a picture with a reference. The displacement is measured from `origin`, the mean shift of earlier pictures
/// against the reference.
fn align(
    reference: &Reference,
    stamp: FrameStamp,
    shifts: &[BlockShift],
    origin: Vector2<f64>,
) -> AlignedPicture {
    let alignment = Alignment::of(shifts);
    let (width, height) = reference.fine().size();
    let centred = |a: Alignment| Alignment { shift: a.shift - origin, ..a };
    let displacement = alignment.map_or(f64::INFINITY, |a| centred(a).displacement(width, height));
    AlignedPicture { stamp, alignment, displacement }
}

/// Whether the last pictures as a whole are displaced. This is so if most of them cannot be aligned, or if their median
/// displacement exceeds `moved` plus their scatter.
fn stays_away(recent: &VecDeque<AlignedPicture>, origin: Vector2<f64>, moved: f64) -> bool {
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
    fn new(picture: &Prepared, stamp: FrameStamp, since: FrameStamp) -> Self {
        let reference = Reference::new(picture);
        let own = align(&reference, stamp, &reference.measured(picture).fine, Vector2::zeros());
        Self { reference, since, pictures: vec![own] }
    }

    /// Whether most of the last pictures are displaced against the candidate.
    fn is_abandoned(&self, moved: f64) -> bool {
        let last = &self.pictures[self.pictures.len().saturating_sub(MEDIAN_PICTURES)..];
        let away = |l: &&AlignedPicture| l.displacement > moved;
        last.len() >= 2 && 2 * last.iter().filter(away).count() > last.len()
    }

    /// Whether the pictures have aligned with the candidate for long enough and without drift.
    fn holds(&self, now: FrameStamp, moved: f64) -> bool {
        let Some(first) = self.pictures.first() else { return false };
        let age_s = now.time_s() - first.stamp.time_s();
        if age_s < HOLD_S || self.pictures.len() < HOLD_PICTURES {
            return false;
        }
        let middle_of = |pictures: &[AlignedPicture]| {
            middle(&pictures.iter().filter_map(|l| l.alignment.as_ref()).collect::<Vec<_>>())
        };
        let (early, late) = self.pictures.split_at(self.pictures.len() / 2);
        match (middle_of(early), middle_of(late)) {
            (Some((a, r)), Some((b, s))) => (b - a).norm().hypot(s - r) < CREEP * moved,
            _ => false,
        }
    }
}

/// Describes a camera move by aligning the new background with the old one.
fn described(old: &Level, new: &Candidate, since: FrameStamp, factor: usize) -> CameraMove {
    let (width, height) = old.size();
    let middle = Vector2::new(width as f64, height as f64) / 2.0;
    let values = new.reference.fine().values();
    let carried = search(old, values).map(|found| refined(old, values, &found));
    let shift = carried.map(|s| (s.apply(&middle) - middle) * factor as f64);
    let log_scale = carried.map(|s| s.log_scale());
    let kind = match log_scale {
        None => MoveKind::Cut,
        Some(log_scale) if log_scale.abs() > ZOOM => MoveKind::Zoomed,
        Some(_) => MoveKind::Turned,
    };
    // Adding zero turns a negative zero into zero.
    let rounded = |value: f64, digits: f64| (value * digits).round() / digits + 0.0;
    CameraMove {
        kind,
        since_frame: since.index,
        since_s: since.time_s(),
        shift_px: shift.map(|s| [rounded(s.x, 10.0), rounded(s.y, 10.0)]),
        log_scale: log_scale.map(|l| rounded(l, 1e4)),
    }
}
