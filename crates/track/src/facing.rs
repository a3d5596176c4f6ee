//! Heading disambiguation: which end of the axis is the front. The keypoints of each frame vote, and so does the
//! direction of travel.

use nalgebra::{Vector2, Vector3};
use roadplane_base::angle_difference;

use crate::measurement::Sighting;

/// Log odds of unanimous keypoints. They are limited, as all frames of one view can be wrong together.
const KEYPOINT_ODDS: f64 = 4.0;
/// Log odds per metre of driving ahead. Some drivers reverse for ten metres, hardly any for fifty.
const ODDS_PER_M: f64 = 0.4;
/// Least distance that is clearly motion and not jitter, m.
pub(crate) const STEP_M: f64 = 1.0;

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

/// Determines the front from keypoints and motion. `axes` holds one continuous axis per detection (rad), and `places`
/// one smoothed pose (x, y, heading).
pub(crate) fn facing(sightings: &[Sighting], axes: &[f64], places: &[Vector3<f64>]) -> Facing {
    let odds = keypoint_odds(sightings, axes) + motion_odds(sightings, axes, places);
    Facing { reversed: odds < 0.0, known: odds.abs() >= KNOWN_ODDS, drove: false }
}

/// Returns the log odds of the keypoints: positive where the axes point to the front.
fn keypoint_odds(sightings: &[Sighting], axes: &[f64]) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for (sighting, axis) in sightings.iter().zip(axes).filter(|(sighting, _)| !sighting.from_box) {
        let weight = 1.0 / (sighting.covariance[(2, 2)] + 0.05);
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
        if (places[to].xy() - places[from].xy()).norm() >= STEP_M {
            odds += ODDS_PER_M * ahead(from, to);
            from = to;
        }
    }
    odds
}
