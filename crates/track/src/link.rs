//! Links tracklets: all continuations are chosen together, by the data before and after each gap.
//!
//! A tracklet holds detections that follow each other without doubt (`tracker.rs`). It has at most one continuation,
//! and continues at most one other tracklet. This is a path cover of least cost: data association as a min-cost flow
//! (Zhang, Li and Nevatia 2008, "Global Data Association for Multi-Object Tracking Using Network Flows"). It works on
//! the ground plane, where the pose's covariance gives the uncertainty (as in UCMCTrack, Yi et al. 2024). Costs belong
//! to pairs only, so the flow is an assignment of ends to beginnings. The assignment separates into groups that cannot
//! reach each other.
//!
//! A pair gains a log likelihood ratio (`continuation.rs`).
//!
//! A vehicle may have two boxes for some frames. A tracklet that begins on one of them continues the tracklet that ends
//! on the other. The earlier one then counts only up to this beginning.
//!
//! A tracklet of boxes alone may be no vehicle. With the probability p that it is one (`existence.rs`), keeping it
//! apart from all others gains −log p. In the assignment, its end is then its own beginning.

use std::collections::BTreeMap;

use nalgebra::Matrix2;
use pathfinding::undirected::connected_components::separate_components;
use roadplane_base::{assign, bbox_iou};

use crate::{
    continuation::{End, density, gain},
    expected::{HIDDEN_S, STATIONARY_S},
    filter::MOTION_S,
    join::{features, probability},
    measurement::Observation,
    numbers::sigmoid,
    raw_track::{Link, RawTrack},
};

/// Half the width of a lane, m: the sd of the distance between tracklets that begin at one place.
const HALF_LANE_M: f64 = 1.5;

/// Joins tracklets into tracks. Gaps of up to [`HIDDEN_S`] are bridged. `exists_log_odds` returns the log odds that a
/// tracklet is a vehicle; `None` for a tracklet that is one beyond doubt. With `cut`, links that are probably wrong are left out.
pub(crate) fn link(
    mut tracklets: Vec<RawTrack>,
    cut: bool,
    exists_log_odds: impl Fn(&RawTrack) -> Option<f64>,
) -> Vec<RawTrack> {
    tracklets.retain(|track| !track.observations.is_empty());
    let starts: Vec<End> = tracklets.iter().map(|track| End::of(track, &track.observations, false)).collect();
    let ends: Vec<End> = tracklets.iter().map(|track| End::of(track, &track.observations, true)).collect();
    let exists_p: Vec<f64> =
        tracklets.iter().map(|track| exists_log_odds(track).map_or(1.0, sigmoid)).collect();
    let arrivals = arrivals(&starts, &ends);
    // A tracklet that continues itself stays apart: probably, it is no vehicle.
    let clutter = |(i, p): (usize, &f64)| (*p < 1.0).then(|| (i, i, -p.max(1e-300).ln()));
    let mut gains: Vec<(usize, usize, f64)> = exists_p.iter().enumerate().filter_map(clutter).collect();
    for (i, end) in ends.iter().enumerate() {
        for (j, start) in starts.iter().enumerate().filter(|(j, _)| *j != i) {
            let before = before_takeover(&tracklets[i], &tracklets[j]);
            let before = before.map(|part| End::of(&tracklets[i], part, true));
            let end = before.as_ref().unwrap_or(end);
            let gap_s = start.time_s - end.time_s;
            if gap_s <= 0.0 || gap_s > HIDDEN_S {
                continue;
            }
            let gain = gain(end, start, gap_s, arrivals(i, j));
            if gain > 0.0 {
                gains.push((i, j, gain));
            }
        }
    }
    let mut next = choose(tracklets.len(), &gains);
    if cut {
        // The likelihoods are simple models. `join.rs` calibrates their odds.
        for (end, link) in ends.iter().zip(&mut next) {
            let is_probable = |&(j, log_odds): &(usize, f64)| {
                probability(features(log_odds, starts[j].time_s - end.time_s)) >= 0.5
            };
            *link = link.filter(is_probable);
        }
    }
    chains(tracklets, &next)
}

/// Returns the earlier tracklet's detections before the later one begins, if it takes over a vehicle that has two boxes
/// for a while. Then it begins near the end of the earlier one, and their boxes touch. `None` without such an overlap.
fn before_takeover<'a>(earlier: &'a RawTrack, later: &RawTrack) -> Option<&'a [Observation]> {
    let (all, new) = (&earlier.observations, &later.observations);
    let (first, last) = (new.first()?, all.last()?);
    let outlasts = first.frame <= last.frame && last.frame < new.last()?.frame;
    if !outlasts || last.time_s - first.time_s > MOTION_S || earlier.is_boxed || later.is_boxed {
        return None;
    }
    let (before, tail) = all.split_at(all.partition_point(|seen| seen.frame < first.frame));
    let touches = |seen: &Observation| {
        let other = &new[new.binary_search_by_key(&seen.frame, |other| other.frame).ok()?];
        Some(bbox_iou(&seen.detection.bbox_px, &other.detection.bbox_px) > 0.0)
    };
    let touching: Vec<bool> = tail.iter().filter_map(touches).collect();
    let most_touch = 2 * touching.iter().filter(|touches| **touches).count() > touching.len();
    (!before.is_empty() && most_touch).then_some(before)
}

/// Returns the rate at which driving vehicles appear where the second of two tracklets begins, per m² and s. The vehicles
/// of both tracklets do not count. A short clip does not show this rate, so [`STATIONARY_S`] is added to its duration.
fn arrivals<'a>(starts: &'a [End], ends: &[End]) -> impl Fn(usize, usize) -> f64 + 'a {
    let first_s = starts.iter().map(|start| start.time_s).fold(f64::INFINITY, f64::min);
    let last_s = ends.iter().map(|end| end.time_s).fold(f64::NEG_INFINITY, f64::max);
    let seconds = (last_s - first_s).max(0.0) + STATIONARY_S;
    // The density of the vehicle of one tracklet where another one begins.
    let near = |start: &End, at: &End| {
        let spread =
            start.place_covariance() + at.place_covariance() + Matrix2::identity() * HALF_LANE_M.powi(2);
        (1.0 - start.stationary_p) * density(&(start.state.xy() - at.state.xy()), &spread)
    };
    let all = |(j, at): (usize, &End)| {
        let others = starts.iter().enumerate().filter(|(k, _)| *k != j);
        others.map(|(_, other)| near(other, at)).sum()
    };
    let all: Vec<f64> = starts.iter().enumerate().map(all).collect();
    move |i, j| (all[j] - near(&starts[i], &starts[j])).max(0.0) / seconds
}

/// Returns, for each tracklet, the one that continues it, with the log odds of the join. `gains` holds (earlier, later,
/// gain).
fn choose(count: usize, gains: &[(usize, usize, f64)]) -> Vec<Option<(usize, f64)>> {
    // Nodes 0 … count − 1 are the ends, and the beginnings follow. Each connected group is assigned alone.
    let nodes: Vec<Vec<usize>> = gains.iter().map(|&(i, j, _)| vec![i, count + j]).collect();
    let mut of_group: BTreeMap<usize, Vec<(usize, usize, f64)>> = BTreeMap::new();
    for (gain, group) in gains.iter().zip(separate_components(&nodes).1) {
        of_group.entry(group).or_default().push(*gain);
    }
    let mut next = vec![None; count];
    for pairs in of_group.values() {
        let sorted = |of: fn(&(usize, usize, f64)) -> usize| {
            let mut all: Vec<usize> = pairs.iter().map(of).collect();
            all.sort_unstable();
            all.dedup();
            all
        };
        let (rows, columns) = (sorted(|p| p.0), sorted(|p| p.1));
        let gains: BTreeMap<(usize, usize), f64> = pairs.iter().map(|&(i, j, gain)| ((i, j), gain)).collect();
        let cost = |r: usize, c: usize| gains.get(&(rows[r], columns[c])).map_or(f64::INFINITY, |gain| -gain);
        for (row, column) in assign(rows.len(), columns.len(), 0.0, cost).into_iter().enumerate() {
            let column = column.map(|c| columns[c]).filter(|c| *c != rows[row]);
            next[rows[row]] = column.map(|c| (c, log_odds(rows[row], c, pairs)));
        }
    }
    next
}

/// Returns the log odds that tracklet `later` continues tracklet `earlier` (`join.rs`). `pairs` has all pairs of their
/// group.
fn log_odds(earlier: usize, later: usize, pairs: &[(usize, usize, f64)]) -> f64 {
    let (mut own, mut others) = (f64::NEG_INFINITY, vec![0.0]);
    for &(i, j, gain) in pairs {
        match (i == earlier, j == later) {
            (true, true) => own = gain,
            (true, false) | (false, true) => others.push(gain),
            (false, false) => {}
        }
    }
    let most = others.iter().copied().fold(0.0, f64::max);
    own - most - others.iter().map(|gain| (gain - most).exp()).sum::<f64>().ln()
}

/// Joins each chain of continuations into one track.
fn chains(tracklets: Vec<RawTrack>, next: &[Option<(usize, f64)>]) -> Vec<RawTrack> {
    let mut begins = vec![true; tracklets.len()];
    next.iter().flatten().for_each(|&(j, _)| begins[j] = false);
    let mut left: Vec<Option<RawTrack>> = tracklets.into_iter().map(Some).collect();
    let mut joined = Vec::new();
    for first in (0..left.len()).filter(|&i| begins[i]) {
        let Some(mut track) = left[first].take() else { continue };
        let mut at = first;
        while let Some((then, log_odds)) = next[at] {
            let Some(later) = left[then].take() else { break };
            let from = later.observations.first().map_or(usize::MAX, |seen| seen.frame);
            // A tracklet that takes over begins before the earlier one ends.
            track.observations.retain(|seen| seen.frame < from);
            track.links.push(Link { frame: from, log_odds });
            track.append(later);
            at = then;
        }
        joined.push(track);
    }
    joined
}
