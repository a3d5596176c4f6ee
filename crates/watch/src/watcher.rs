//! Is the camera at rest?
//!
//! A picture is laid against the background ([`Alignment`]). One that lies elsewhere starts a suspicion, with that picture as the
//! candidate for a new position: it becomes the new position if the pictures after it lie on it for a second, and gives its
//! place to a later one if they do not. Coming back to the old background ends a suspicion. So a shake, which comes back, a
//! flash, or a lorry that covers everything are no moves; and a move is told a second after it happened, with the frame in which
//! it did.

use std::collections::VecDeque;

use nalgebra::Vector2;
use roadplane_base::{CameraMove, FrameStamp, MoveKind, PictureVerdict, WatchRecord, median};

use crate::alignment::Alignment;
use crate::blind::Blindness;
use crate::level::{BlockShift, Level};
use crate::reference::{Prepared, Reference};
use crate::search::{refined, search};
use crate::{SmallGrey, WatchError};

/// A camera that stays so far from where it was has moved, px of the frame; half as much is how far a position holds.
const MOVED_PX: f64 = 1.5;
/// … or px of the small picture, whichever is more.
const MOVED_SMALL_PX: f64 = 0.3;
/// Time over which the median displacement is taken, s: longer than half a swing of a pole.
const MEDIAN_S: f64 = 0.5;
/// Pictures that it takes at least.
const MEDIAN_PICTURES: usize = 4;
/// A new position must hold for so long, s …
const HOLD_S: f64 = 1.0;
/// … and so many pictures.
const HOLD_PICTURES: usize = 4;
/// Creeping by more than this within the time that it must hold is no holding, as a share of [`MOVED_PX`].
const CREEP: f64 = 0.35;
/// A suspicion that lasts so long is motion if its first candidate did not hold, s …
const MOTION_S: f64 = 1.5;
/// … and whatever its candidates do after so long, s.
const LONG_MOTION_S: f64 = 4.0;
/// Growth of the picture, log, from which on a move is called a zoom.
const ZOOM: f64 = 0.01;
/// Shake below this is within the noise of boxes and keypoints, px of the frame.
const LEAST_OFFSET_PX: f64 = 0.5;
/// Pictures over which the middle of the shake is averaged at most: some 20 s.
const AVERAGED: f64 = 180.0;
/// Blocks with structure below which the picture cannot tell.
const MIN_BLOCKS: usize = 8;

/// What is remembered is at most so old, s of the input, counted from its start …
const MINUTE_S: f64 = 60.0;
/// … and so much when it begins to be used, s: the time over which the middle of the shake is averaged.
pub const RENEW_S: f64 = 20.0;

/// What the watcher makes of a frame.
#[derive(Clone, Debug)]
pub struct Seen {
    /// For the frame's record.
    pub record: WatchRecord,
    /// The small picture.
    pub small: SmallGrey,
    /// Its shift against the background at rest, px of the small picture.
    pub shift: Vector2<f64>,
    /// Another position of the camera: nothing of the picture before holds.
    pub is_new_position: bool,
}

/// One picture laid against a reference.
#[derive(Clone, Copy, Debug)]
struct Laid {
    stamp: FrameStamp,
    alignment: Option<Alignment>,
    /// Root mean square displacement, px of the small picture; infinite where it cannot be laid.
    displacement: f64,
}

/// A position that the camera may have come to.
#[derive(Clone, Debug)]
struct Candidate {
    reference: Reference,
    since: FrameStamp,
    laid: Vec<Laid>,
}

#[derive(Clone, Debug)]
struct Suspicion {
    since: FrameStamp,
    candidate: Candidate,
    /// Candidates that did not hold.
    left: u32,
    /// It was told that the camera moves.
    is_motion: bool,
}

/// A position of the camera: the background there, and how pictures lie on it.
#[derive(Clone, Debug, Default)]
struct Position {
    reference: Option<Reference>,
    /// The last pictures against the background.
    recent: VecDeque<Laid>,
    /// Where pictures lie against the background on average, px of the small picture: the middle of the shake.
    origin: Vector2<f64>,
    /// Pictures that the average is of.
    averaged: f64,
    suspicion: Option<Suspicion>,
}

/// Watches a clip, frame by frame.
#[derive(Clone, Debug, Default)]
pub struct Watcher {
    blindness: Blindness,
    position: Position,
    /// What will take its place, and the minute from which on.
    next: Option<(u64, Position)>,
    last: WatchRecord,
}

impl Watcher {
    /// Before the first frame.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// What holds for a frame whose picture nobody looks at.
    #[must_use]
    pub fn unlooked(&self) -> WatchRecord {
        WatchRecord {
            looked: false,
            verdict: self.last.verdict,
            offset_px: self.last.offset_px,
            ..WatchRecord::default()
        }
    }

    /// Looks at the next frame, in the order of time.
    ///
    /// # Errors
    /// [`WatchError`] when OpenCV fails.
    pub fn look(&mut self, stamp: FrameStamp, image: &image::RgbImage) -> Result<Seen, WatchError> {
        let small = SmallGrey::of(image)?;
        let blind = self.blindness.look(&small, stamp.time_s());
        let mut record = WatchRecord { looked: true, ..WatchRecord::default() };
        let mut shift = Vector2::zeros();
        let mut is_new_position = false;
        if let Some(verdict) = blind {
            record.verdict = verdict;
        } else {
            self.renew(stamp.time_s());
            let before = self.position.reference.is_some();
            let picture = Prepared::of(&small);
            self.position.settle(stamp, &small, &picture, &mut record);
            if let Some((_, next)) = &mut self.next {
                next.settle(stamp, &small, &picture, &mut WatchRecord::default());
            }
            is_new_position = before && record.moved.is_some_and(|m| m.kind != MoveKind::Moving);
            // What is unsettled may be a slow swing, and is where it is until a move is told.
            if matches!(record.verdict, PictureVerdict::Rest | PictureVerdict::Unsettled)
                && let Some(alignment) = self.position.recent.back().and_then(|laid| laid.alignment)
            {
                shift = alignment.shift - self.position.origin;
                let offset = shift * small.factor as f64;
                if offset.norm() >= LEAST_OFFSET_PX {
                    record.offset_px = [offset.x, offset.y].map(|v| (v * 100.0).round() / 100.0);
                }
            }
        }
        self.last = record.clone();
        Ok(Seen { record, small, shift, is_new_position })
    }

    /// Begins what is to come, and lets it take over as soon as neither suspects a move.
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
    /// Finds the verdict on a picture that shows something.
    fn settle(&mut self, stamp: FrameStamp, small: &SmallGrey, picture: &Prepared, record: &mut WatchRecord) {
        let moved = (MOVED_PX / small.factor as f64).max(MOVED_SMALL_PX);
        let reference = match &mut self.reference {
            Some(reference) if reference.fine().size() == (small.width, small.height) => reference,
            slot => slot.insert(Reference::new(picture)),
        };
        if reference.fine().block_count() < MIN_BLOCKS {
            // A first picture without structure (night, fog) is no background for one that has some, all over: not for a car
            // on a bare road.
            let fresh = Reference::new(picture);
            if fresh.fine().is_structured_all_over() {
                *reference = fresh;
            } else {
                let told = reference.told(picture);
                reference.follow(picture, &told, stamp.time_s());
                record.verdict = PictureVerdict::Unknown;
                return;
            }
        }
        let told = reference.told(picture);
        let laid = laid(reference, stamp, &told.fine, self.origin);
        self.recent.push_back(laid);
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
                if let Some(alignment) = laid.alignment {
                    self.averaged = (self.averaged + 1.0).min(AVERAGED);
                    self.origin += (alignment.shift - self.origin) / self.averaged;
                    if (alignment.shift).norm() < moved {
                        reference.follow(picture, &told, stamp.time_s());
                    }
                }
            }
            None => {
                // It began with the first of the last pictures that lies off.
                let off = |l: &&Laid| l.displacement > 0.5 * moved;
                let since = self.recent.iter().rev().take_while(off).last().map_or(stamp, |l| l.stamp);
                let candidate = Candidate::new(picture, stamp, since);
                self.suspicion = Some(Suspicion { since, candidate, left: 0, is_motion: false });
                record.verdict = PictureVerdict::Unsettled;
            }
            Some(suspicion) => {
                if !stays_away && !suspicion.is_motion && laid.displacement < moved {
                    self.suspicion = None;
                    record.verdict = PictureVerdict::Rest;
                    return;
                }
                record.verdict =
                    if suspicion.is_motion { PictureVerdict::Moving } else { PictureVerdict::Unsettled };
                let candidate = &mut suspicion.candidate;
                let told = candidate.reference.told(picture);
                candidate.laid.push(self::laid(&candidate.reference, stamp, &told.fine, Vector2::zeros()));
                if candidate.is_left(moved) {
                    *candidate = Candidate::new(picture, stamp, stamp);
                    suspicion.left += 1;
                } else if candidate.holds(stamp, moved) {
                    let since = if suspicion.is_motion { candidate.since } else { suspicion.since };
                    record.moved = Some(described(reference.fine(), candidate, since, small.factor));
                    record.verdict = PictureVerdict::Rest;
                    (self.origin, self.averaged) = (Vector2::zeros(), 0.0);
                    if let Some(Suspicion { candidate, .. }) = self.suspicion.take() {
                        self.reference = Some(candidate.reference);
                        self.recent = candidate.laid.into();
                    }
                    return;
                }
                let lasts_s = stamp.time_s() - suspicion.since.time_s();
                let moves = (suspicion.left > 0 && lasts_s > MOTION_S) || lasts_s > LONG_MOTION_S;
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

/// A picture laid against a reference, from which pictures lie `origin` off on average.
fn laid(reference: &Reference, stamp: FrameStamp, told: &[BlockShift], origin: Vector2<f64>) -> Laid {
    let alignment = Alignment::of(told);
    let (width, height) = reference.fine().size();
    let centred = |a: Alignment| Alignment { shift: a.shift - origin, ..a };
    let displacement = alignment.map_or(f64::INFINITY, |a| centred(a).displacement(width, height));
    Laid { stamp, alignment, displacement }
}

/// Whether the last pictures lie elsewhere, all in all: most cannot be laid, or the median of where they lie is farther off than
/// they scatter.
fn stays_away(recent: &VecDeque<Laid>, origin: Vector2<f64>, moved: f64) -> bool {
    let (Some(first), Some(last)) = (recent.front(), recent.back()) else { return false };
    if recent.len() < MEDIAN_PICTURES || last.stamp.time_s() - first.stamp.time_s() < 0.5 * MEDIAN_S {
        return false;
    }
    let laid: Vec<&Alignment> = recent.iter().filter_map(|l| l.alignment.as_ref()).collect();
    if 2 * laid.len() < recent.len() {
        return true;
    }
    let Some((shift, grown)) = middle(&laid) else { return false };
    let scatter = median(&mut laid.iter().map(|a| (a.shift - shift).norm()).collect::<Vec<_>>());
    (shift - origin).norm().hypot(grown) > moved + scatter.unwrap_or(0.0)
}

/// Median shift, and median displacement by scale and roll at 100 px from the middle.
fn middle(laid: &[&Alignment]) -> Option<(Vector2<f64>, f64)> {
    let of = |value: fn(&Alignment) -> f64| median(&mut laid.iter().map(|a| value(a)).collect::<Vec<_>>());
    let shift = Vector2::new(of(|a| a.shift.x)?, of(|a| a.shift.y)?);
    Some((shift, 100.0 * of(|a| a.log_scale)?.hypot(of(|a| a.roll)?)))
}

impl Candidate {
    fn new(picture: &Prepared, stamp: FrameStamp, since: FrameStamp) -> Self {
        let reference = Reference::new(picture);
        let own = laid(&reference, stamp, &reference.told(picture).fine, Vector2::zeros());
        Self { reference, since, laid: vec![own] }
    }

    /// Most of the last pictures lie elsewhere, or the pictures creep away.
    fn is_left(&self, moved: f64) -> bool {
        let last = &self.laid[self.laid.len().saturating_sub(MEDIAN_PICTURES)..];
        let away = |l: &&Laid| l.displacement > moved;
        last.len() >= 2 && 2 * last.iter().filter(away).count() > last.len()
    }

    /// For long enough, and without creeping.
    fn holds(&self, now: FrameStamp, moved: f64) -> bool {
        let Some(first) = self.laid.first() else { return false };
        let age_s = now.time_s() - first.stamp.time_s();
        if age_s < HOLD_S || self.laid.len() < HOLD_PICTURES {
            return false;
        }
        let middle_of =
            |laid: &[Laid]| middle(&laid.iter().filter_map(|l| l.alignment.as_ref()).collect::<Vec<_>>());
        let (early, late) = self.laid.split_at(self.laid.len() / 2);
        match (middle_of(early), middle_of(late)) {
            (Some((a, r)), Some((b, s))) => (b - a).norm().hypot(s - r) < CREEP * moved,
            _ => false,
        }
    }
}

/// What kind of move it was, by laying the new position on the old one.
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
    // No negative zero.
    let rounded = |value: f64, digits: f64| (value * digits).round() / digits + 0.0;
    CameraMove {
        kind,
        since_frame: since.index,
        since_s: since.time_s(),
        shift_px: shift.map(|s| [rounded(s.x, 10.0), rounded(s.y, 10.0)]),
        log_scale: log_scale.map(|l| rounded(l, 1e4)),
    }
}
