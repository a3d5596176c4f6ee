//! Stop lines: places where the first vehicles of queues stop again and again.
//!
//! Vehicles also stop elsewhere, for example behind a parked vehicle. If such places were random, few of them would be
//! close together: a scan statistic (Naus 1965) decides.

use nalgebra::Vector2;

use super::{
    border::{HALF_LANE_M, SAME_DIRECTION_COS},
    cluster::{FEWEST, LINK_ACROSS_M},
    lane::{Lane, StopLine},
    path::{Path, QUEUE_MPS},
};
use crate::{Clip, State, Vehicle};

/// Shortest stop, s, and the speed that it must reach, m/s.
const SHORTEST_S: f64 = 2.0;
const AT_REST_MPS: f32 = 0.5;
/// Distance that a vehicle must drive before a stop and after it, m, unless it comes into view or leaves it driving. A
/// vehicle that parks does not drive on.
const DRIVES_M: f64 = 10.0;
/// Longest gap between two vehicles of a queue, m. PTV Vissim's manual gives 10 to 20 m as usual. The largest value allows
/// for a vehicle that was not detected.
const AHEAD_M: f64 = 20.0;
/// Length of road on which drivers stop at one line, m. The places of the first vehicles have an sd of about 1 m.
const WITHIN_M: f64 = 4.0;
/// Time between two queues, s: less than the shortest red phases.
const APART_S: f64 = 10.0;
/// Probability with which random places count as a stop line.
const CHANCE_P: f64 = 0.01;

/// A stop of the first vehicle of a queue.
#[derive(Clone, Copy, Debug)]
struct Head {
    /// Place of the front bumper, m.
    front: Vector2<f64>,
    /// Unit vector along the travel.
    forward: Vector2<f64>,
    /// Length of the vehicle's path, m.
    path_m: f64,
    clip: usize,
    time_s: f64,
}

/// Returns the stop lines.
pub(super) fn stop_lines(clips: &[&Clip], paths: &[Path], lanes: &[Lane]) -> Vec<StopLine> {
    let heads: Vec<Head> = paths.iter().flat_map(|path| path_heads(clips, path)).collect();
    let mut lines = Vec::new();
    for mut group in directions(heads) {
        let Some(axis) = group.iter().map(|head| head.forward).sum::<Vector2<f64>>().try_normalize(0.0)
        else {
            continue;
        };
        group.sort_by(|a, b| a.front.dot(&axis).total_cmp(&b.front.dot(&axis)));
        let mut places: Vec<Vec<Head>> = Vec::new();
        while let Some(cluster) = densest(&group, &axis) {
            places.push(group.drain(cluster).collect());
        }
        // If the first vehicle is not seen, the second seems to be the first: such a place is behind that of more queues.
        let along =
            |place: &[Head]| place.iter().map(|head| head.front.dot(&axis)).sum::<f64>() / place.len() as f64;
        let behind =
            |a: &[Head], b: &[Head]| a.len() <= b.len() && (0.1..AHEAD_M).contains(&(along(b) - along(a)));
        let first = |place: &&Vec<Head>| !places.iter().any(|other| behind(place, other));
        lines.extend(places.iter().filter(first).flat_map(|place| on_lanes(place, &axis, lanes)));
    }
    lines
}

/// Returns the stops of a vehicle as the first of a queue.
fn path_heads(clips: &[&Clip], path: &Path) -> Vec<Head> {
    let clip = clips[path.clip];
    let vehicle = &clip.vehicles[path.vehicle];
    let slow = |state: &State| f64::from(state.speed_mps).abs() < QUEUE_MPS;
    let mut heads = Vec::new();
    for run in vehicle.states.chunk_by(|a, b| slow(a) == slow(b)).filter(|run| slow(&run[0])) {
        let (first, last) = (&run[0], &run[run.len() - 1]);
        let slowest =
            run.iter().rev().min_by(|a, b| a.speed_mps.abs().total_cmp(&b.speed_mps.abs())).unwrap_or(first);
        if last.time_s - first.time_s < SHORTEST_S || slowest.speed_mps.abs() > AT_REST_MPS {
            continue;
        }
        let along = |time_s: f64| {
            let next = path.points.partition_point(|point| point.state.time_s <= time_s);
            path.points[next.saturating_sub(1)].along_m
        };
        let drove = path.begins || along(first.time_s) >= DRIVES_M;
        let drives_on = path.ends || path.length_m() - along(last.time_s) >= DRIVES_M;
        if !drove || !drives_on {
            continue;
        }
        let forward = slowest.forward();
        let front = slowest.position() + forward * (vehicle.length_m / 2.0);
        if !is_led(clip, path.vehicle, (first.time_s + last.time_s) / 2.0, &front, &forward) {
            heads.push(Head {
                front,
                forward,
                path_m: path.length_m(),
                clip: path.clip,
                time_s: first.time_s,
            });
        }
    }
    heads
}

/// Whether another vehicle queues ahead of a front bumper.
fn is_led(clip: &Clip, vehicle: usize, time_s: f64, front: &Vector2<f64>, forward: &Vector2<f64>) -> bool {
    let leads = |other: &Vehicle| {
        let [from, to] = other.span_s();
        let Some(state) = (from <= time_s && time_s <= to).then(|| other.at(time_s)).flatten() else {
            return false;
        };
        let away = state.position() - front;
        let gap_m = away.dot(forward) - other.length_m / 2.0;
        // Half of the vehicle ahead may be past the bumper, if its length is wrong.
        f64::from(state.speed_mps).abs() < QUEUE_MPS
            && state.forward().dot(forward) > 0.0
            && away.dot(forward) > 0.0
            && gap_m < AHEAD_M
            && away.perp(forward).abs() < HALF_LANE_M
    };
    clip.vehicles.iter().enumerate().any(|(i, other)| i != vehicle && leads(other))
}

/// Returns groups of stops in one direction on one road, ordered by their first stop.
fn directions(heads: Vec<Head>) -> Vec<Vec<Head>> {
    let same = |a: &Head, b: &Head| {
        a.forward.dot(&b.forward) >= SAME_DIRECTION_COS
            && (b.front - a.front).perp(&a.forward).abs() < LINK_ACROSS_M
            && (b.front - a.front).perp(&b.forward).abs() < LINK_ACROSS_M
    };
    let mut groups: Vec<Vec<Head>> = Vec::new();
    for head in heads {
        let (joined, others): (Vec<_>, Vec<_>) =
            groups.into_iter().partition(|group| group.iter().any(|other| same(&head, other)));
        groups = others;
        let mut group: Vec<Head> = joined.into_iter().flatten().collect();
        group.push(head);
        groups.push(group);
    }
    groups
}

/// Returns the range of the densest stops, if they are too many for chance. The stops are sorted along the axis.
fn densest(heads: &[Head], axis: &Vector2<f64>) -> Option<std::ops::Range<usize>> {
    let along: Vec<f64> = heads.iter().map(|head| head.front.dot(axis)).collect();
    let range = |from: usize| from..along.partition_point(|&a| a <= along[from] + WITHIN_M);
    let best = (0..heads.len()).map(range).min_by_key(|range| usize::MAX - range.len())?;
    let queues = queues(&heads[best.clone()]);
    let mut lengths: Vec<f64> = heads.iter().map(|head| head.path_m).collect();
    lengths.sort_unstable_by(f64::total_cmp);
    let length_m = lengths[lengths.len() / 2].max(2.0 * WITHIN_M);
    let chance = heads.len() as f64 * binomial_tail(best.len() - 1, heads.len() - 1, WITHIN_M / length_m);
    (best.len() >= FEWEST && queues >= 2 && chance < CHANCE_P).then_some(best)
}

/// Returns the number of queues at different times: the first vehicles of two lanes may stop in one red phase.
fn queues(heads: &[Head]) -> usize {
    let mut times: Vec<(usize, f64)> = heads.iter().map(|head| (head.clip, head.time_s)).collect();
    times.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    1 + times.windows(2).filter(|pair| pair[0].0 != pair[1].0 || pair[1].1 - pair[0].1 > APART_S).count()
}

/// Returns the probability of at least `least` successes in `trials`.
fn binomial_tail(least: usize, trials: usize, p: f64) -> f64 {
    let mut term = (1.0 - p).powi(trials as i32);
    let mut below = 0.0;
    for k in 0..least {
        below += term;
        term *= (trials - k) as f64 / (k + 1) as f64 * p / (1.0 - p);
    }
    (1.0 - below).max(0.0)
}

/// Returns the stop line of each lane on which vehicles stopped.
fn on_lanes(heads: &[Head], axis: &Vector2<f64>, lanes: &[Lane]) -> Vec<StopLine> {
    let count = heads.len() as f64;
    let mean = heads.iter().map(|head| head.front.dot(axis)).sum::<f64>() / count;
    let variance =
        heads.iter().map(|head| (head.front.dot(axis) - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let line = |lane: Option<usize>, place: Vector2<f64>, forward: Vector2<f64>| StopLine {
        lane,
        place: place + forward * ((mean - place.dot(axis)) / forward.dot(axis).max(0.5)),
        forward,
        sd_m: (variance / count).sqrt(),
        spread_m: variance.sqrt(),
        queues: heads.len(),
    };
    let mut lines: Vec<StopLine> = Vec::new();
    for head in heads {
        let near = lanes.iter().enumerate().filter_map(|(i, lane)| {
            let nodes = lane.middle.windows(2).map(|pair| ((pair[0] - head.front).norm_squared(), pair));
            let (square, pair) = nodes.min_by(|a, b| a.0.total_cmp(&b.0))?;
            let forward = (pair[1] - pair[0]).try_normalize(0.0)?;
            let aside_m = (pair[0] - head.front).perp(&forward).abs();
            // A head is beside a node, not beyond the end of the lane.
            let fits = aside_m <= HALF_LANE_M && square <= HALF_LANE_M.powi(2) * 2.0;
            (fits && forward.dot(&head.forward) >= SAME_DIRECTION_COS)
                .then_some((aside_m, i, pair[0], forward))
        });
        let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
        let found = nearest.map_or_else(
            || line(None, head.front, head.forward),
            |(_, i, at, forward)| line(Some(i), at, forward),
        );
        // Lanes of two flows share their approach: it has one line.
        let near = |other: &StopLine| (other.place - found.place).perp(&found.forward).abs() < HALF_LANE_M;
        if !lines.iter().any(near) {
            lines.push(found);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_binomial_tail_is_a_probability() {
        assert!((binomial_tail(0, 5, 0.3) - 1.0).abs() < 1e-12);
        assert!((binomial_tail(5, 5, 0.3) - 0.3_f64.powi(5)).abs() < 1e-12);
        assert!((binomial_tail(1, 2, 0.5) - 0.75).abs() < 1e-12);
    }
}
