//! Two tracks of one car become one: two cars cannot share space.

use crate::{
    measurement::Observation,
    tracker::{RawTrack, same_car},
};

/// Share of the weaker track's sightings that must coincide with the stronger one.
const MIN_SHARED: f64 = 0.5;
/// Sightings of the two tracks that are farther apart in time are not compared, s.
const NEAR_S: f64 = 0.5;

/// Keeps the stronger of two tracks of one car and fills its gaps from the weaker.
pub(crate) fn merge_duplicates(mut tracks: Vec<RawTrack>) -> Vec<RawTrack> {
    let strength = |track: &RawTrack| track.observations.iter().map(|o| o.score.max(0.01)).sum::<f64>();
    let first = |track: &RawTrack| track.observations.first().map(|o| (o.frame, o.pose.x, o.pose.y));
    tracks.sort_by(|a, b| {
        let (fa, fb) = (first(a).unwrap_or_default(), first(b).unwrap_or_default());
        let by_place = fa.0.cmp(&fb.0).then(fa.1.total_cmp(&fb.1)).then(fa.2.total_cmp(&fb.2));
        strength(b).total_cmp(&strength(a)).then(by_place)
    });
    let mut kept: Vec<RawTrack> = Vec::new();
    for track in tracks {
        match kept.iter().position(|strong| coincide(strong, &track)) {
            Some(index) => fill(&mut kept[index], track),
            None => kept.push(track),
        }
    }
    kept
}

fn coincide(strong: &RawTrack, weak: &RawTrack) -> bool {
    let shared =
        weak.observations.iter().filter(|o| at(strong, o).is_some_and(|near| same_car(near, o))).count();
    shared as f64 > MIN_SHARED * weak.observations.len() as f64
}

/// The sighting nearest in time to another track's.
fn at<'a>(track: &'a RawTrack, other: &Observation) -> Option<&'a Observation> {
    let after = track.observations.partition_point(|o| o.frame < other.frame);
    let around = [after.checked_sub(1), Some(after)].into_iter().flatten();
    let near = around.filter_map(|i| track.observations.get(i));
    let gap_s = |o: &Observation| (o.time_s - other.time_s).abs();
    near.min_by(|a, b| gap_s(a).total_cmp(&gap_s(b))).filter(|o| gap_s(o) <= NEAR_S)
}

fn fill(strong: &mut RawTrack, weak: RawTrack) {
    for observation in weak.observations {
        if let Err(place) = strong.observations.binary_search_by_key(&observation.frame, |o| o.frame)
            && at(strong, &observation).is_some_and(|near| same_car(near, &observation))
        {
            strong.observations.insert(place, observation);
        }
    }
}
