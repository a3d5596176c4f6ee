//! Computes the states from which the least-squares solution of a path starts.

use nalgebra::{Vector2, Vector3};
use roadplane_base::{angle_difference, fold_axis};
use roadplane_measure::HEADING_SD_RAD;

use crate::{
    filter::{MOTION_S, STILL_M},
    measurement::Observation,
    parked::ParkedPose,
    path_parts::PathPart,
    vehicle::{State, state_at},
};

/// Log odds of unanimous keypoints. They are limited, as all frames of one view can be wrong together.
const KEYPOINT_ODDS: f64 = 4.0;
/// Log odds per metre of driving ahead. Some drivers reverse for ten metres, hardly any for fifty.
const ODDS_PER_M: f64 = 0.4;
/// Log odds below which the front is undetermined.
const CLEAR_ODDS: f64 = 1.0;

/// The result of the heading disambiguation of a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrontChoice {
    /// Whether the front is determined.
    pub known: bool,
    /// Whether the path shows the axis.
    pub drove: bool,
}

/// Returns the states to start from, and the result of the heading disambiguation. Positions are the detected ones, slightly averaged.
/// The axis comes from motion where there is some, else from keypoints. The front comes from both.
pub(crate) fn start(
    observations: &[Observation],
    parts: &[PathPart],
    half_wheelbase_m: f64,
) -> (Vec<State>, FrontChoice) {
    let averaged: Vec<Vector3<f64>> = (0..observations.len())
        .map(|i| {
            let near = &observations[i.saturating_sub(2)..(i + 3).min(observations.len())];
            near.iter().map(|o| o.pose).sum::<Vector3<f64>>() / near.len() as f64
        })
        .collect();
    let mut parked: Vec<Option<ParkedPose>> = vec![None; observations.len()];
    for part in parts {
        parked[part.observations.clone()].fill(part.parked);
    }
    let centres: Vec<Vector3<f64>> = parked
        .iter()
        .zip(&averaged)
        .map(|(parked, seen)| parked.map_or(*seen, |parked| parked.pose))
        .collect();
    let (axes, drove) = axes(observations, &averaged, &parked);
    let odds = keypoint_odds(observations, &axes) + motion_odds(observations, &axes, &centres);
    let front = FrontChoice { known: odds.abs() >= CLEAR_ODDS, drove };
    let turn = if odds < 0.0 { std::f64::consts::PI } else { 0.0 };
    // The state of a part lies on the straight line between the detections around it.
    let state = |part: &PathPart| {
        let (time_s, last) = (part.span_s[0], observations.len() - 1);
        let to = observations.partition_point(|o| o.time_s < time_s).min(last);
        let from = to.saturating_sub(1);
        let gap_s = observations[to].time_s - observations[from].time_s;
        let since_s = time_s - observations[from].time_s;
        let share = if gap_s > 0.0 { (since_s / gap_s).clamp(0.0, 1.0) } else { 1.0 };
        let centre = centres[from] + share * (centres[to] - centres[from]);
        let heading = axes[from] + share * (axes[to] - axes[from]) + turn;
        let (near, far) = (from.saturating_sub(3), (to + 3).min(last));
        let long_s = observations[far].time_s - observations[near].time_s;
        let moved = centres[far].xy() - centres[near].xy();
        let ahead = moved.dot(&Vector2::new(heading.cos(), heading.sin()));
        let speed = if part.parked.is_some() || long_s <= 0.0 { 0.0 } else { ahead / long_s };
        state_at(&Vector3::new(centre.x, centre.y, heading), speed, half_wheelbase_m)
    };
    (parts.iter().map(state).collect(), front)
}

/// Returns an axis (rad) for each detection, and whether any motion shows an axis. Each axis differs by less than π/2
/// from the one before. It is the path's where there is one, else the detected one. A detection by box alone has the
/// path's axis nearest in time, as a box shows little of the axis.
fn axes(
    observations: &[Observation],
    averaged: &[Vector3<f64>],
    parked: &[Option<ParkedPose>],
) -> (Vec<f64>, bool) {
    let directions: Vec<Option<f64>> = (0..observations.len())
        .map(|i| if parked[i].is_none() { direction_at(observations, averaged, i) } else { None })
        .collect();
    let nearest_direction = |i: usize| {
        let away_s = |k: usize| (observations[k].time_s - observations[i].time_s).abs();
        let clear = (0..directions.len()).filter(|k| directions[*k].is_some());
        clear.min_by(|a, b| away_s(*a).total_cmp(&away_s(*b))).and_then(|k| directions[k])
    };
    let mut axes: Vec<f64> = Vec::with_capacity(observations.len());
    for (i, seen) in observations.iter().enumerate() {
        let by_box = || if seen.from_box { nearest_direction(i) } else { None };
        let axis =
            directions[i].or_else(by_box).unwrap_or(parked[i].map_or(seen.pose.z, |parked| parked.pose.z));
        let before = axes.last().copied().unwrap_or(axis);
        axes.push(before + fold_axis(axis - before));
    }
    (axes, directions.iter().any(Option::is_some))
}

/// Returns the direction of travel (rad) around a detection, where it is clear.
fn direction_at(observations: &[Observation], averaged: &[Vector3<f64>], i: usize) -> Option<f64> {
    let time_s = observations[i].time_s;
    let sd = observations[i].covariance.fixed_view::<2, 2>(0, 0).trace().sqrt();
    let from = observations.partition_point(|o| o.time_s < time_s - MOTION_S / 2.0).min(i);
    let to = observations.partition_point(|o| o.time_s <= time_s + MOTION_S / 2.0).max(i + 1) - 1;
    let moved = averaged[to].xy() - averaged[from].xy();
    (moved.norm() > STILL_M + sd).then(|| moved.y.atan2(moved.x))
}

/// Returns the log odds of the keypoints: positive where the axes point to the front.
fn keypoint_odds(observations: &[Observation], axes: &[f64]) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for (seen, axis) in observations.iter().zip(axes).filter(|(seen, _)| !seen.from_box) {
        let weight = 1.0 / (seen.covariance[(2, 2)] + HEADING_SD_RAD.powi(2));
        sum += weight * angle_difference(seen.pose.z, *axis).cos().signum();
        total += weight;
    }
    if total > 0.0 { KEYPOINT_ODDS * sum / total } else { 0.0 }
}

/// Returns the log odds of the motion: positive where the axes point to the front.
fn motion_odds(observations: &[Observation], axes: &[f64], centres: &[Vector3<f64>]) -> f64 {
    // A change from a position by keypoints to one by box is no motion. Only the more frequent kind counts.
    let by_box = 2 * observations.iter().filter(|o| o.from_box).count() > observations.len();
    let mut alike = (0..centres.len()).filter(|i| observations[*i].from_box == by_box);
    let Some(mut from) = alike.next() else { return 0.0 };
    let ahead = |from: usize, to: usize| {
        let axis = (axes[from] + axes[to]) / 2.0;
        (centres[to].xy() - centres[from].xy()).dot(&Vector2::new(axis.cos(), axis.sin()))
    };
    let mut odds = 0.0;
    for to in alike {
        if (centres[to].xy() - centres[from].xy()).norm() >= STILL_M {
            odds += ODDS_PER_M * ahead(from, to);
            from = to;
        }
    }
    odds
}
