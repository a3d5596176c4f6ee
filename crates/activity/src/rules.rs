//! What the whole of a stretch says about its label, of which the net sees a part: who has left a place, who was seen to stand, how
//! far a way bends.

use std::ops::Range;

use roadplane_base::angle_difference;

use crate::decode::Probabilities;
use crate::label::Label;
use crate::motion::{Motion, STEP_S};

/// A stand that was not seen this close to a start or stop (s) is guesswork, too: the vehicle drives on, as far as anyone can tell.
const SEEN_STAND_S: f64 = 1.0;
/// What comes no farther than half a car's length between two stands has stood: tracks of hidden and far cars waver so much, m.
const MOVED_M: f64 = 2.2;
/// The same of what has but one stand, as its track begins or ends, m: nobody knows how far it would have come.
const LEFT_M: f64 = 1.0;
/// A stretch whose way bends by less is no turn, rad (12°: lanes that swing, boxes cut by the picture's edge) …
const TURNED_RAD: f64 = 0.21;
/// … and one that bends by less no U-turn (130°, between the sharpest turns and half turns).
const U_TURN_RAD: f64 = 2.27;
/// No vehicle drives a tighter circle, m (cars need 4 to 6): what a way bends beyond is noise, as of a few samples beside each
/// other.
const LEAST_RADIUS_M: f64 = 3.0;

/// Where a motion is in a stretch of steps, m.
fn places<'a>(motion: &'a Motion, stretch: &[i64]) -> &'a [[f64; 2]] {
    let (Some(from), Some(to)) = (stretch.first(), stretch.last()) else { return &[] };
    let first = motion.time_s.partition_point(|t| *t < *from as f64 * STEP_S);
    let last = motion.time_s.partition_point(|t| *t <= *to as f64 * STEP_S);
    motion.xy_m.get(first..last).unwrap_or_default()
}

/// Turns what does not leave its place beside a stand into standing.
pub(crate) fn settle(labels: &mut [usize], steps: &[i64], motion: &Motion) {
    let still = Label::NotMoving.index();
    let mut from = 0;
    let runs: Vec<(usize, usize)> = labels
        .chunk_by(|a, b| (*a == still) == (*b == still))
        .map(|run| {
            let begin = from;
            from += run.len();
            (begin, from)
        })
        .collect();
    for (begin, end) in runs {
        let least_m = match (begin > 0, end < labels.len()) {
            (true, true) => MOVED_M,
            (false, false) => continue,
            _ => LEFT_M,
        };
        let places = places(motion, &steps[begin..end]);
        let stays = places.iter().all(|xy| (xy[0] - places[0][0]).hypot(xy[1] - places[0][1]) < least_m);
        if labels[begin] != still && stays {
            labels[begin..end].fill(still);
        }
    }
}

/// Turns starts from stands, and stops to stands, that nobody saw into driving on.
pub(crate) fn drive_on(labels: &mut [usize], found: &Probabilities) {
    let mut to = 0;
    let run = |run: &[usize]| {
        to += run.len();
        to - run.len()..to
    };
    let runs: Vec<Range<usize>> = labels.chunk_by(|a, b| a == b).map(run).collect();
    for (i, run) in runs.iter().enumerate() {
        let (stand, change) = match Label::ALL[labels[run.start]] {
            Label::Starting => (i.checked_sub(1), run.start),
            Label::Stopping => (Some(i + 1), run.end - 1),
            _ => continue,
        };
        let is_stand = |run: &&Range<usize>| labels[run.start] == Label::NotMoving.index();
        let Some(stand) = stand.and_then(|i| runs.get(i)).filter(is_stand) else { continue };
        let near = |step: usize| {
            (found.steps[step] - found.steps[change]).abs() as f64 * STEP_S <= SEEN_STAND_S + 1e-6
        };
        if !stand.clone().any(|step| near(step) && found.gap_s[step] <= STEP_S / 2.0) {
            labels[run.clone()].fill(Label::Moving.index());
        }
    }
}

/// Turns have to bend the way of the vehicle, and U-turns bend it far; the net sees but a part of a long stretch.
pub(crate) fn bend(labels: &mut [usize], steps: &[i64], motion: &Motion) {
    let turns = [Label::TurningLeft, Label::TurningRight, Label::UTurn].map(Label::index);
    let mut from = 0;
    for run in labels.chunk_by_mut(|a, b| a == b) {
        let (begin, end) = (from, from + run.len());
        from = end;
        if !turns.contains(&run[0]) {
            continue;
        }
        let Some(turned_rad) = turned(places(motion, &steps[begin..end])) else { continue };
        if turned_rad.abs() < TURNED_RAD {
            run.fill(Label::Moving.index());
        } else if run[0] == Label::UTurn.index() && turned_rad.abs() < U_TURN_RAD {
            let side = if turned_rad > 0.0 { Label::TurningLeft } else { Label::TurningRight };
            run.fill(side.index());
        }
    }
}

/// By how much a way bends, to the left, rad: twice the angle between its halves' chords, which for an arc is all of it, and no
/// more than a vehicle can.
pub(crate) fn turned(places: &[[f64; 2]]) -> Option<f64> {
    let (first, last) = (places.first()?, places.last()?);
    let steps = places.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1]));
    let way: Vec<f64> = steps
        .scan(0.0, |way, step| {
            *way += step;
            Some(*way)
        })
        .collect();
    let length_m = way.last().copied().unwrap_or(0.0);
    let middle = places.get(way.partition_point(|to| *to < length_m / 2.0))?;
    let chord = |a: &[f64; 2], b: &[f64; 2]| (b[1] - a[1]).atan2(b[0] - a[0]);
    let most_rad = length_m / LEAST_RADIUS_M;
    Some((2.0 * angle_difference(chord(middle, last), chord(first, middle))).clamp(-most_rad, most_rad))
}
