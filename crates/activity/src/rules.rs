//! Rules that correct a label by the motion in its whole interval. The net considers only a part of that interval.
//!
//! The rules check whether the vehicle left its position, whether it was observed at rest, and how far its path turns.

use std::ops::Range;

use roadplane_base::angle_difference;

use crate::label::Label;
use crate::motion::{Motion, STEP_S};
use crate::probabilities::Probabilities;

/// Longest time between a start or stop and an observed sample at rest, s. Without such a sample the rest is uncertain,
/// and the label of the start or stop becomes moving.
const SEEN_REST_S: f64 = 1.0;
/// Least distance that a vehicle moves between two rests, m. It is half the length of a car. The positions of hidden
/// and distant cars vary by less.
const MOVED_M: f64 = 2.2;
/// Least distance that a vehicle moves beside a rest, if its track begins or ends during the motion, m. The full
/// distance is then unknown, so this limit is lower than [`MOVED_M`].
const LEFT_M: f64 = 1.0;
/// Least change of direction along a turn, rad (12°). Winding lanes cause smaller changes, and so do boxes at the
/// picture's edge.
const TURNED_RAD: f64 = 0.21;
/// Least change of direction along a U-turn, rad (130°). The value is between the sharpest turns and half turns.
const U_TURN_RAD: f64 = 2.27;
/// Smallest radius that a vehicle can drive, m (cars need 4 to 6 m). A tighter turn is noise. It can appear when a few
/// samples lie close together.
const LEAST_RADIUS_M: f64 = 3.0;

/// Returns the positions of a motion during an interval of steps, m.
fn positions<'a>(motion: &'a Motion, interval: &[i64]) -> &'a [[f64; 2]] {
    let (Some(from), Some(to)) = (interval.first(), interval.last()) else { return &[] };
    let first = motion.time_s.partition_point(|t| *t < *from as f64 * STEP_S);
    let last = motion.time_s.partition_point(|t| *t <= *to as f64 * STEP_S);
    motion.xy_m.get(first..last).unwrap_or_default()
}

/// Corrects labels of motion beside a rest: if the vehicle stays near its position, the label becomes not moving.
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
        let path = positions(motion, &steps[begin..end]);
        let stays = path.iter().all(|xy| (xy[0] - path[0][0]).hypot(xy[1] - path[0][1]) < least_m);
        if labels[begin] != still && stays {
            labels[begin..end].fill(still);
        }
    }
}

/// Corrects starts and stops: if the rest before a start or after a stop was not observed, the label becomes moving.
pub(crate) fn drive_on(labels: &mut [usize], found: &Probabilities) {
    let mut to = 0;
    let run = |run: &[usize]| {
        to += run.len();
        to - run.len()..to
    };
    let runs: Vec<Range<usize>> = labels.chunk_by(|a, b| a == b).map(run).collect();
    for (i, run) in runs.iter().enumerate() {
        let (rest, change) = match Label::ALL[labels[run.start]] {
            Label::Starting => (i.checked_sub(1), run.start),
            Label::Stopping => (Some(i + 1), run.end - 1),
            _ => continue,
        };
        let is_rest = |run: &&Range<usize>| labels[run.start] == Label::NotMoving.index();
        let Some(rest) = rest.and_then(|i| runs.get(i)).filter(is_rest) else { continue };
        let near = |step: usize| {
            (found.steps[step] - found.steps[change]).abs() as f64 * STEP_S <= SEEN_REST_S + 1e-6
        };
        if !rest.clone().any(|step| near(step) && found.gap_s[step] <= STEP_S / 2.0) {
            labels[run.clone()].fill(Label::Moving.index());
        }
    }
}

/// Corrects turns: the label of a straight path becomes moving. A U-turn with a small change of direction becomes a
/// left or right turn.
pub(crate) fn check_turns(labels: &mut [usize], steps: &[i64], motion: &Motion) {
    let turns = [Label::TurningLeft, Label::TurningRight, Label::UTurn].map(Label::index);
    let mut from = 0;
    for run in labels.chunk_by_mut(|a, b| a == b) {
        let (begin, end) = (from, from + run.len());
        from = end;
        if !turns.contains(&run[0]) {
            continue;
        }
        let Some(turned_rad) = turned(positions(motion, &steps[begin..end])) else { continue };
        if turned_rad.abs() < TURNED_RAD {
            run.fill(Label::Moving.index());
        } else if run[0] == Label::UTurn.index() && turned_rad.abs() < U_TURN_RAD {
            let side = if turned_rad > 0.0 { Label::TurningLeft } else { Label::TurningRight };
            run.fill(side.index());
        }
    }
}

/// Returns the angle by which a path turns, rad, positive to the left. Returns `None` if the path is too short.
///
/// The path is cut into two halves of equal length. The result is twice the angle between their chords; for an arc,
/// this is the exact angle. The result is limited to the angle that a vehicle can turn on a path of this length.
pub(crate) fn turned(path: &[[f64; 2]]) -> Option<f64> {
    let (first, last) = (path.first()?, path.last()?);
    let steps = path.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1]));
    let driven_m: Vec<f64> = steps
        .scan(0.0, |driven, step| {
            *driven += step;
            Some(*driven)
        })
        .collect();
    let length_m = driven_m.last().copied().unwrap_or(0.0);
    let middle = path.get(driven_m.partition_point(|to| *to < length_m / 2.0))?;
    let chord = |a: &[f64; 2], b: &[f64; 2]| (b[1] - a[1]).atan2(b[0] - a[0]);
    let most_rad = length_m / LEAST_RADIUS_M;
    Some((2.0 * angle_difference(chord(middle, last), chord(first, middle))).clamp(-most_rad, most_rad))
}
