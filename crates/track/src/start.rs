//! Computes the states from which the least-squares solution of a path starts.

use nalgebra::{Vector2, Vector3};
use roadplane_base::{angle_difference, fold_axis};
use roadplane_measure::HEADING_SD_RAD;

use crate::{
    filter::{MOTION_S, STILL_M},
    measurement::Sighting,
    parked::Stand,
    vehicle::{State, state_at},
    way::Place,
};

/// Log odds of unanimous keypoints. They are limited, as all frames of one view can be wrong together.
const KEYPOINT_ODDS: f64 = 4.0;
/// Log odds per metre of driving ahead. Some drivers reverse for ten metres, hardly any for fifty.
const ODDS_PER_M: f64 = 0.4;
/// Log odds below which the front is undetermined.
const KNOWN_ODDS: f64 = 1.0;

/// The direction in which a track's headings point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Facing {
    /// Whether headings that follow the axis must be turned by π.
    pub reversed: bool,
    /// Whether the front is determined.
    pub known: bool,
    /// Whether the path shows the axis.
    pub drove: bool,
}

/// Returns the states to start from, and the disambiguated heading. Positions are the detected ones, slightly averaged.
/// The axis comes from motion where there is some, else from keypoints. The front comes from both.
pub(crate) fn start(sightings: &[Sighting], places: &[Place], half_wheelbase_m: f64) -> (Vec<State>, Facing) {
    let averaged: Vec<Vector3<f64>> = (0..sightings.len())
        .map(|i| {
            let near = &sightings[i.saturating_sub(2)..(i + 3).min(sightings.len())];
            near.iter().map(|o| o.pose).sum::<Vector3<f64>>() / near.len() as f64
        })
        .collect();
    let mut stands: Vec<Option<Stand>> = vec![None; sightings.len()];
    for place in places {
        stands[place.sightings.clone()].fill(place.stand);
    }
    let centres: Vec<Vector3<f64>> =
        stands.iter().zip(&averaged).map(|(stand, seen)| stand.map_or(*seen, |stand| stand.pose)).collect();
    let (axes, drove) = axes(sightings, &averaged, &stands);
    let facing = Facing { drove, ..facing(sightings, &axes, &centres) };
    let turn = if facing.reversed { std::f64::consts::PI } else { 0.0 };
    let states = places
        .iter()
        .map(|place| {
            let (pose, speed) = interpolated(sightings, &centres, &axes, place, turn);
            state_at(&pose, speed, half_wheelbase_m)
        })
        .collect();
    (states, facing)
}

/// Returns an axis (rad) for each detection, and whether any motion shows an axis. Each axis differs by less than π/2
/// from the one before. It is the path's where there is one, else the detected one. A detection by box alone has the
/// path's axis nearest in time, as a box shows little of the axis.
fn axes(sightings: &[Sighting], averaged: &[Vector3<f64>], stands: &[Option<Stand>]) -> (Vec<f64>, bool) {
    let ways: Vec<Option<f64>> = (0..sightings.len())
        .map(|i| if stands[i].is_none() { way_at(sightings, averaged, i) } else { None })
        .collect();
    let nearest_way = |i: usize| {
        let away_s = |k: usize| (sightings[k].time_s - sightings[i].time_s).abs();
        let told = (0..ways.len()).filter(|k| ways[*k].is_some());
        told.min_by(|a, b| away_s(*a).total_cmp(&away_s(*b))).and_then(|k| ways[k])
    };
    let mut axes: Vec<f64> = Vec::with_capacity(sightings.len());
    for (i, seen) in sightings.iter().enumerate() {
        let by_box = || if seen.from_box { nearest_way(i) } else { None };
        let axis = ways[i].or_else(by_box).unwrap_or(stands[i].map_or(seen.pose.z, |stand| stand.pose.z));
        let before = axes.last().copied().unwrap_or(axis);
        axes.push(before + fold_axis(axis - before));
    }
    (axes, ways.iter().any(Option::is_some))
}

/// Returns the direction of travel (rad) around a detection, where it is clear.
fn way_at(sightings: &[Sighting], averaged: &[Vector3<f64>], i: usize) -> Option<f64> {
    let time_s = sightings[i].time_s;
    let sd = sightings[i].covariance.fixed_view::<2, 2>(0, 0).trace().sqrt();
    let from = sightings.partition_point(|o| o.time_s < time_s - MOTION_S / 2.0).min(i);
    let to = sightings.partition_point(|o| o.time_s <= time_s + MOTION_S / 2.0).max(i + 1) - 1;
    let way = averaged[to].xy() - averaged[from].xy();
    (way.norm() > STILL_M + sd).then(|| way.y.atan2(way.x))
}

/// Returns pose (m, rad) and speed (m/s) of a node, on the straight line between the detections around it. `turn` is
/// added to the heading, rad.
fn interpolated(
    sightings: &[Sighting],
    centres: &[Vector3<f64>],
    axes: &[f64],
    place: &Place,
    turn: f64,
) -> (Vector3<f64>, f64) {
    let time_s = place.span_s[0];
    let last = sightings.len() - 1;
    let to = sightings.partition_point(|o| o.time_s < time_s).min(last);
    let from = to.saturating_sub(1);
    let gap_s = sightings[to].time_s - sightings[from].time_s;
    let share = if gap_s > 0.0 { ((time_s - sightings[from].time_s) / gap_s).clamp(0.0, 1.0) } else { 1.0 };
    let centre = centres[from] + share * (centres[to] - centres[from]);
    let heading = axes[from] + share * (axes[to] - axes[from]) + turn;
    let (near, far) = (from.saturating_sub(3), (to + 3).min(last));
    let long_s = sightings[far].time_s - sightings[near].time_s;
    let way = centres[far].xy() - centres[near].xy();
    let ahead = way.dot(&Vector2::new(heading.cos(), heading.sin()));
    let speed = if place.stand.is_some() || long_s <= 0.0 { 0.0 } else { ahead / long_s };
    (Vector3::new(centre.x, centre.y, heading), speed)
}

/// Determines the front from keypoints and motion. `axes` holds one continuous axis per detection (rad), and `places`
/// one smoothed pose (x, y, heading).
fn facing(sightings: &[Sighting], axes: &[f64], places: &[Vector3<f64>]) -> Facing {
    let odds = keypoint_odds(sightings, axes) + motion_odds(sightings, axes, places);
    Facing { reversed: odds < 0.0, known: odds.abs() >= KNOWN_ODDS, drove: false }
}

/// Returns the log odds of the keypoints: positive where the axes point to the front.
fn keypoint_odds(sightings: &[Sighting], axes: &[f64]) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for (sighting, axis) in sightings.iter().zip(axes).filter(|(sighting, _)| !sighting.from_box) {
        let weight = 1.0 / (sighting.covariance[(2, 2)] + HEADING_SD_RAD.powi(2));
        sum += weight * angle_difference(sighting.pose.z, *axis).cos().signum();
        total += weight;
    }
    if total > 0.0 { KEYPOINT_ODDS * sum / total } else { 0.0 }
}

/// Returns the log odds of the motion: positive where the axes point to the front.
fn motion_odds(sightings: &[Sighting], axes: &[f64], places: &[Vector3<f64>]) -> f64 {
    // A change from a position by keypoints to one by box is no motion. Only the more frequent kind counts.
    let by_box = 2 * sightings.iter().filter(|sighting| sighting.from_box).count() > sightings.len();
    let mut alike = (0..places.len()).filter(|i| sightings[*i].from_box == by_box);
    let Some(mut from) = alike.next() else { return 0.0 };
    let ahead = |from: usize, to: usize| {
        let axis = (axes[from] + axes[to]) / 2.0;
        (places[to].xy() - places[from].xy()).dot(&Vector2::new(axis.cos(), axis.sin()))
    };
    let mut odds = 0.0;
    for to in alike {
        if (places[to].xy() - places[from].xy()).norm() >= STILL_M {
            odds += ODDS_PER_M * ahead(from, to);
            from = to;
        }
    }
    odds
}
