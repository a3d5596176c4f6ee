//! Smooths a vehicle that boxes place. Its stationary and driving intervals follow from the path as a whole.

use nalgebra::{Matrix3, Vector3};
use roadplane_base::VehicleClass;
use roadplane_measure::Body;

use crate::{
    Scene, TrackState,
    by_boxes::{ByBoxes, Look},
    filter::STANDING_MPS,
    frames::Frames,
    measurement::Sighting,
    parked::stand,
    raw_track::RawTrack,
    stops::{close_gaps, runs},
    vehicle::Node,
    way::{Place, Way, per_view, places},
};

/// Returns the states and the size of a vehicle where boxes, and not keypoints, give its pose. For a vehicle that is no
/// car they always do. Returns `None` if no pose comes from a box, or if boxes and path contradict each other. Also
/// returns `None` if the vehicle did not drive and has no keypoints, as then its heading is open.
pub(crate) fn smooth_by_boxes(
    track: &RawTrack,
    frames: &Frames,
    scene: &impl Scene,
) -> Option<(Vec<TrackState>, Body)> {
    let (sightings, half_wheelbase_m) = (&track.observations, track.half_wheelbase_m());
    let Frames { stamps, times_s, .. } = frames;
    let body = &scene.body(track.class(), &track.shape.fused().mean);
    let start_m = track.dims_m().unwrap_or(body.dims_m);
    let by_box = |seen: &Sighting| !seen.detection.held && (seen.from_box || body.class != VehicleClass::Car);
    let by_pose = |seen: &Sighting| !seen.detection.held && !by_box(seen);
    if !sightings.iter().any(by_box) {
        return None;
    }
    let by_poses =
        Way::by_poses(track, times_s).filter(|way| way.facing.drove || sightings.iter().any(by_pose))?;
    let solve = |before: &Way, moving: &[bool], start_m: Vector3<f64>| {
        let mut places = places(sightings, times_s, &runs(moving));
        let measured = |place: &mut Place| {
            let seen = &sightings[place.sightings.clone()];
            let poses: Vec<Sighting> = seen.iter().filter(|seen| by_pose(seen)).cloned().collect();
            if poses.is_empty() {
                return None;
            }
            if place.stand.is_some() {
                place.stand = stand(&poses);
            }
            place.measured(sightings, by_poses.noise)
        };
        let measured: Vec<_> = places.iter_mut().map(measured).collect();
        let look = |(place, measured): (&Place, &Option<_>)| {
            let together = per_view(sightings, place.nearest);
            let seen = Look::of(&sightings[place.sightings.clone()], together, |seen| stamps[seen.frame]);
            seen.filter(|_| measured.is_none())
        };
        let looks: Vec<Option<Look>> = places.iter().zip(&measured).map(look).collect();
        let node = |(place, measured): (&Place, _)| Node {
            span_s: place.span_s,
            measured,
            parked: place.stand.is_some(),
        };
        let nodes: Vec<Node> = places.iter().zip(measured).map(node).collect();
        let start =
            places.iter().map(|place| before.state_at(place.span_s[0])).collect::<Option<Vec<_>>>()?;
        let problem = ByBoxes { nodes: &nodes, looks: &looks, body, start_m, scene, half_wheelbase_m };
        let solved = problem.solve(start)?;
        let way = Way { places, nodes: solved.states, covariances: solved.covariances, ..*before };
        Some((way, solved.body))
    };
    // First assume that it drove in every measured frame: the whole path determines speeds better than one second of it
    // does.
    let mut moving: Vec<bool> = sightings.iter().map(|seen| !seen.detection.held).collect();
    close_gaps(&mut moving, sightings);
    let (drive, found) = solve(&by_poses, &moving, start_m)?;
    for (seen, moving) in sightings.iter().zip(&mut moving) {
        *moving &= drive.state_at(seen.time_s)?[3].abs() >= STANDING_MPS;
    }
    close_gaps(&mut moving, sightings);
    let (way, found) = solve(&drive, &moving, found.dims_m)?;
    let states = way.states(sightings, stamps, |place| {
        let is_measured = sightings[place.sightings.clone()].iter().any(by_pose);
        if is_measured { place.bias(sightings, way.noise) } else { Matrix3::zeros() }
    });
    Some((states, found))
}
