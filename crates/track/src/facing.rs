//! Which end of the axis is the front: what keypoints say, frame by frame, against the way the car drives.

use nalgebra::{Vector2, Vector3};
use roadplane_base::angle_difference;

use crate::measurement::Sighting;

/// Log odds that unanimous keypoints give: all frames of one view can be wrong together.
const KEYPOINT_ODDS: f64 = 4.0;
/// Log odds of driving ahead, per metre: some reverse for ten metres, hardly anybody for fifty.
const ODDS_PER_M: f64 = 0.4;
/// Nobody reverses faster than this, m/s, for so long, s: over shorter times places jitter by as much.
const MAX_REVERSE_MPS: f64 = 4.0;
const FAST_S: f64 = 0.5;
const FAST_ODDS: f64 = 6.0;
/// Way that is told from jitter, m.
const STEP_M: f64 = 1.0;

/// Log odds below which nobody knows which end is the front.
const KNOWN_ODDS: f64 = 1.0;

/// Which way a track's headings point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Facing {
    /// Headings that follow the axis must be turned by π.
    pub reversed: bool,
    /// Something says so, or says that they must not.
    pub known: bool,
    /// Its way shows how it was turned.
    pub drove: bool,
}

/// By keypoints and motion. `axes`: one per sighting, continuous. `places`: smoothed.
pub(crate) fn facing(sightings: &[Sighting], axes: &[f64], places: &[Vector3<f64>]) -> Facing {
    let odds = keypoint_odds(sightings, axes) + motion_odds(sightings, axes, places);
    Facing { reversed: odds < 0.0, known: odds.abs() >= KNOWN_ODDS, drove: false }
}

fn keypoint_odds(sightings: &[Sighting], axes: &[f64]) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for (sighting, axis) in sightings.iter().zip(axes).filter(|(sighting, _)| !sighting.from_box) {
        let weight = 1.0 / (sighting.covariance[(2, 2)] + 0.05);
        sum += weight * angle_difference(sighting.pose.z, *axis).cos().signum();
        total += weight;
    }
    if total > 0.0 { KEYPOINT_ODDS * sum / total } else { 0.0 }
}

fn motion_odds(sightings: &[Sighting], axes: &[f64], places: &[Vector3<f64>]) -> f64 {
    // From a place by keypoints to one by the box is no motion: those count that are more.
    let by_box = 2 * sightings.iter().filter(|sighting| sighting.from_box).count() > sightings.len();
    let mut alike = (0..places.len()).filter(|i| sightings[*i].from_box == by_box);
    let Some(mut from) = alike.next() else { return 0.0 };
    let ahead = |from: usize, to: usize| {
        let axis = (axes[from] + axes[to]) / 2.0;
        (places[to].xy() - places[from].xy()).dot(&Vector2::new(axis.cos(), axis.sin()))
    };
    let (mut odds, mut fastest): (f64, f64) = (0.0, 0.0);
    let mut since = from;
    for to in alike {
        let seconds = sightings[to].time_s - sightings[since].time_s;
        if seconds >= FAST_S {
            let speed = ahead(since, to) / seconds;
            if speed.abs() > fastest.abs() {
                fastest = speed;
            }
            since = to;
        }
        if (places[to].xy() - places[from].xy()).norm() >= STEP_M {
            odds += ODDS_PER_M * ahead(from, to);
            from = to;
        }
    }
    odds + if fastest.abs() > MAX_REVERSE_MPS { FAST_ODDS * fastest.signum() } else { 0.0 }
}
