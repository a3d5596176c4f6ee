//! Merges two tracks of one car: two cars cannot share space.

use nalgebra::Vector3;

use crate::{
    TrackState,
    filter::MOTION_S,
    measurement::Observation,
    raw_track::{FEWEST, Link, RawTrack, in_one_place, same_car},
};

/// Longest time between two detections that are compared, s. The vehicle may move in a longer time.
const NEAR_S: f64 = MOTION_S / 2.0;

/// Keeps the stronger of two tracks of one car. The weaker fills its gaps and extends it at both ends.
pub(crate) fn merge_duplicates(tracks: Vec<RawTrack>) -> Vec<RawTrack> {
    let mut kept: Vec<RawTrack> = Vec::new();
    for track in by_strength(tracks) {
        let same = |near: &Observation, own: &Observation| is_near(near, own) && same_car(near, own);
        match kept.iter_mut().find(|strong| coincide(strong, &track, same)) {
            Some(strong) => fill(strong, track),
            None => kept.push(track),
        }
    }
    kept
}

/// Merges tracks of one car by their smoothed poses, and returns them with their states. Single detections scatter too
/// much to show that these tracks coincide.
pub(crate) fn merge_smoothed(
    tracks: Vec<RawTrack>,
    smooth: impl Fn(&RawTrack) -> Vec<TrackState>,
) -> Vec<(RawTrack, Vec<TrackState>)> {
    let mut kept: Vec<(RawTrack, Vec<TrackState>)> = Vec::new();
    for track in by_strength(tracks) {
        let states = smooth(&track);
        let strong = kept.iter().position(|(strong, strong_states)| {
            coincide(strong, &track, |near, own| {
                // While the stronger track is not detected, its filled states show where it is.
                let there = pose(strong, strong_states, own).or_else(|| pose(strong, strong_states, near));
                pose(&track, &states, own).zip(there).is_some_and(|(a, b)| {
                    in_one_place(&a, &own.detection.bbox_px, &b, &near.detection.bbox_px)
                })
            })
        });
        match strong.map(|index| &mut kept[index]) {
            Some((strong, strong_states)) => {
                fill(strong, track);
                *strong_states = smooth(strong);
            }
            None => kept.push((track, states)),
        }
    }
    kept
}

/// Returns a track's smoothed pose (x, y, heading) at a detection, m and rad. States begin with the first detection,
/// one per frame.
fn pose(track: &RawTrack, states: &[TrackState], observation: &Observation) -> Option<Vector3<f64>> {
    let first = track.observations.first()?.frame;
    let pose = states.get(observation.frame.checked_sub(first)?)?.pose;
    Some(Vector3::new(pose.x_m, pose.y_m, pose.heading_rad))
}

/// Sorts tracks, the strongest first.
fn by_strength(mut tracks: Vec<RawTrack>) -> Vec<RawTrack> {
    let strength =
        |track: &RawTrack| track.observations.iter().map(|o| o.detection.score.max(0.01)).sum::<f64>();
    let first = |track: &RawTrack| track.observations.first().map(|o| (o.frame, o.pose.x, o.pose.y));
    tracks.sort_by(|a, b| {
        let (fa, fb) = (first(a).unwrap_or_default(), first(b).unwrap_or_default());
        let by_place = fa.0.cmp(&fb.0).then(fa.1.total_cmp(&fb.1)).then(fa.2.total_cmp(&fb.2));
        strength(b).total_cmp(&strength(a)).then(by_place)
    });
    tracks
}

/// Whether two tracks coincide: most of the weaker track's detections during the stronger track's life. `same` compares
/// each of them with the stronger track's detection that is nearest in time.
fn coincide(strong: &RawTrack, weak: &RawTrack, same: impl Fn(&Observation, &Observation) -> bool) -> bool {
    let together: Vec<&Observation> = weak.observations.iter().filter(|o| lives(strong, o.time_s)).collect();
    let shared = together.iter().filter(|o| nearest(strong, o).is_some_and(|near| same(near, o))).count();
    shared >= FEWEST.min(weak.observations.len()) && 2 * shared > together.len()
}

/// Whether a time (s) lies between a track's first and last detection, or near them.
fn lives(track: &RawTrack, time_s: f64) -> bool {
    let ends = track.observations.first().zip(track.observations.last());
    ends.is_some_and(|(first, last)| first.time_s - NEAR_S < time_s && time_s < last.time_s + NEAR_S)
}

/// Returns the detection that is nearest in time to one of another track.
fn nearest<'a>(track: &'a RawTrack, other: &Observation) -> Option<&'a Observation> {
    let after = track.observations.partition_point(|o| o.frame < other.frame);
    let around = [after.checked_sub(1), Some(after)].into_iter().flatten();
    let gap_s = |o: &Observation| (o.time_s - other.time_s).abs();
    let near = around.filter_map(|i| track.observations.get(i));
    near.min_by(|a, b| gap_s(a).total_cmp(&gap_s(b)))
}

/// Whether two detections are near in time.
fn is_near(a: &Observation, b: &Observation) -> bool {
    (a.time_s - b.time_s).abs() <= NEAR_S
}

/// Inserts the detections of the weaker track where the stronger has none.
fn fill(strong: &mut RawTrack, weak: RawTrack) {
    let ends = strong.observations.first().zip(strong.observations.last()).map(|(a, b)| [a.frame, b.frame]);
    let before_or_after =
        |o: &Observation| ends.is_some_and(|[first, last]| o.frame < first || o.frame > last);
    let is_outside =
        |link: &&Link| ends.is_some_and(|[first, last]| link.frame <= first || link.frame > last);
    strong.links.extend(weak.links.iter().filter(is_outside));
    strong.links.sort_by_key(|link| link.frame);
    strong.seen_again += weak.seen_again;
    strong.is_boxed &= weak.is_boxed;
    for observation in weak.observations {
        if let Err(place) = strong.observations.binary_search_by_key(&observation.frame, |o| o.frame)
            && (before_or_after(&observation)
                || nearest(strong, &observation)
                    .is_some_and(|near| !is_near(near, &observation) || same_car(near, &observation)))
        {
            strong.observations.insert(place, observation);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Detection;
    use nalgebra::Matrix3;
    use roadplane_base::{FrameStamp, GroundPose, VehicleClass};

    /// Returns the track of a stationary car that is detected in these frames, ten per second.
    fn parked(x_m: f64, frames: impl Iterator<Item = usize>) -> RawTrack {
        let seen = |frame| Observation {
            frame,
            time_s: 0.1 * frame as f64,
            pose: Vector3::new(x_m, 30.0, 0.0),
            covariance: Matrix3::identity() * 0.04,
            detection: Detection::uncut([100.0, 100.0, 160.0, 140.0], 0.8, VehicleClass::Car),
            from_box: false,
            fit_rms_share: None,
        };
        RawTrack { observations: frames.map(seen).collect(), ..RawTrack::default() }
    }

    /// Returns a state for each frame from the first detection to the last, at the position of the first.
    fn stationary(track: &RawTrack) -> Vec<TrackState> {
        let (first, last) = (&track.observations[0], &track.observations[track.observations.len() - 1]);
        let state = |frame: usize| TrackState {
            stamp: FrameStamp { index: frame as u64, pts_nanos: 0 },
            pose: GroundPose { x_m: first.pose.x, y_m: 30.0, heading_rad: 0.0 },
            pose_sd: Vector3::zeros(),
            speed_mps: 0.0,
            speed_sd_mps: 0.0,
            bbox_px: None,
            score: 0.0,
            car: None,
        };
        (first.frame..=last.frame).map(state).collect()
    }

    #[test]
    fn a_car_in_the_place_of_a_track_that_is_not_detected_is_the_same() {
        let gap = || RawTrack { is_boxed: true, ..parked(0.0, (0..30).chain(70..100)) };
        let merged = |x_m: f64| merge_smoothed(vec![gap(), parked(x_m, 40..60)], stationary);
        let one = merged(0.5);
        assert_eq!(one.len(), 1);
        assert_eq!(one[0].0.observations.len(), 80);
        assert!(!one[0].0.is_boxed, "its detections are not all boxes");
        assert!(one[0].0.observations.is_sorted_by_key(|seen| seen.frame));
        assert_eq!(merged(4.0).len(), 2);
    }
}
