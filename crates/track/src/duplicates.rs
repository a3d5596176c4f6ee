//! Merges two tracks of one car: two cars cannot share space.

use nalgebra::Vector3;

use crate::{
    TrackState,
    filter::MOTION_S,
    measurement::Sighting,
    raw_track::{FEWEST, Link, RawTrack, in_one_place, same_car},
};

/// Longest time between two detections that are compared, s. The vehicle may move in a longer time.
const NEAR_S: f64 = MOTION_S / 2.0;

/// Keeps the stronger of two tracks of one car. The weaker fills its gaps and extends it at both ends.
pub(crate) fn merge_duplicates(tracks: Vec<RawTrack>) -> Vec<RawTrack> {
    let mut kept: Vec<RawTrack> = Vec::new();
    for track in by_strength(tracks) {
        match kept.iter().position(|strong| coincide(strong, &track, same_car)) {
            Some(index) => fill(&mut kept[index], track),
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
                let poses = pose(strong, strong_states, near).zip(pose(&track, &states, own));
                poses.is_some_and(|(a, b)| {
                    in_one_place(&a, &near.detection.bbox_px, &b, &own.detection.bbox_px)
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
fn pose(track: &RawTrack, states: &[TrackState], sighting: &Sighting) -> Option<Vector3<f64>> {
    let first = track.observations.first()?.frame;
    let pose = states.get(sighting.frame.checked_sub(first)?)?.pose;
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
/// a detection of the stronger track with one of the weaker.
fn coincide(strong: &RawTrack, weak: &RawTrack, same: impl Fn(&Sighting, &Sighting) -> bool) -> bool {
    let together: Vec<&Sighting> = weak.observations.iter().filter(|o| lives(strong, o.time_s)).collect();
    let shared = together.iter().filter(|o| at(strong, o).is_some_and(|near| same(near, o))).count();
    shared >= FEWEST.min(weak.observations.len()) && 2 * shared > together.len()
}

/// Whether a time (s) lies between a track's first and last detection, or near them.
fn lives(track: &RawTrack, time_s: f64) -> bool {
    let ends = track.observations.first().zip(track.observations.last());
    ends.is_some_and(|(first, last)| first.time_s - NEAR_S < time_s && time_s < last.time_s + NEAR_S)
}

/// Returns the detection that is nearest in time to one of another track; `None` if it is too far away in time.
fn at<'a>(track: &'a RawTrack, other: &Sighting) -> Option<&'a Sighting> {
    let after = track.observations.partition_point(|o| o.frame < other.frame);
    let around = [after.checked_sub(1), Some(after)].into_iter().flatten();
    let near = around.filter_map(|i| track.observations.get(i));
    let gap_s = |o: &Sighting| (o.time_s - other.time_s).abs();
    near.min_by(|a, b| gap_s(a).total_cmp(&gap_s(b))).filter(|o| gap_s(o) <= NEAR_S)
}

/// Inserts the detections of the weaker track where the stronger has none.
fn fill(strong: &mut RawTrack, weak: RawTrack) {
    let ends = strong.observations.first().zip(strong.observations.last()).map(|(a, b)| [a.frame, b.frame]);
    let before_or_after = |o: &Sighting| ends.is_some_and(|[first, last]| o.frame < first || o.frame > last);
    let is_outside =
        |link: &&Link| ends.is_some_and(|[first, last]| link.frame <= first || link.frame > last);
    strong.links.extend(weak.links.iter().filter(is_outside));
    strong.links.sort_by_key(|link| link.frame);
    for observation in weak.observations {
        if let Err(place) = strong.observations.binary_search_by_key(&observation.frame, |o| o.frame)
            && (before_or_after(&observation)
                || at(strong, &observation).is_some_and(|near| same_car(near, &observation)))
        {
            strong.observations.insert(place, observation);
        }
    }
}
