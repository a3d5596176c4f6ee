//! Smooths a vehicle that boxes place. Its stationary and driving intervals follow from the path as a whole.

use nalgebra::{Matrix3, Vector3};
use roadplane_base::VehicleClass;
use roadplane_measure::Body;

use crate::{
    Scene, TrackState,
    by_boxes::{BoxEvidence, ByBoxes},
    filter::STATIONARY_MPS,
    frames::Frames,
    measurement::Observation,
    parked::parked_pose,
    path::Path,
    path_parts::{PathPart, path_parts, per_view},
    raw_track::RawTrack,
    stops::{close_gaps, runs},
    vehicle::{Node, Vehicle},
};

/// Returns the states and the size of a vehicle where boxes, and not keypoints, give its pose. For a vehicle that is no
/// car they always do. Returns `None` if no pose comes from a box, or if boxes and path contradict each other. Also
/// returns `None` if the vehicle did not drive and has no keypoints, as then its heading is open.
pub(crate) fn smooth_by_boxes(
    track: &RawTrack,
    frames: &Frames,
    scene: &impl Scene,
) -> Option<(Vec<TrackState>, Body)> {
    let observations = &track.observations;
    let Frames { stamps, times_s, .. } = frames;
    let body = &scene.body(track.class(), &track.shape.fused().mean);
    let start_m = track.dims_m().unwrap_or(body.dims_m);
    let by_box = |seen: &Observation| {
        !seen.detection.carried_over && (seen.from_box || body.class != VehicleClass::Car)
    };
    let by_pose = |seen: &Observation| !seen.detection.carried_over && !by_box(seen);
    if !observations.iter().any(by_box) {
        return None;
    }
    let pose_path =
        Path::by_poses(track, times_s).filter(|path| path.front.drove || observations.iter().any(by_pose))?;
    let solve = |before: &Path, moving: &[bool], start_m: Vector3<f64>| {
        let mut parts = path_parts(observations, times_s, &runs(moving));
        let measured = |part: &mut PathPart| {
            let own = &observations[part.observations.clone()];
            let poses: Vec<Observation> = own.iter().filter(|seen| by_pose(seen)).cloned().collect();
            if poses.is_empty() {
                return None;
            }
            if part.parked.is_some() {
                part.parked = parked_pose(&poses);
            }
            part.measured(observations, pose_path.noise)
        };
        let measured: Vec<_> = parts.iter_mut().map(measured).collect();
        let evidence_of = |(part, measured): (&PathPart, &Option<_>)| {
            let together = per_view(observations, part.nearest);
            let combined = BoxEvidence::of(&observations[part.observations.clone()], together, stamps);
            combined.filter(|_| measured.is_none())
        };
        let evidence: Vec<Option<BoxEvidence>> = parts.iter().zip(&measured).map(evidence_of).collect();
        let nodes: Vec<Node> = parts.iter().zip(measured).map(|(part, one)| part.node(one)).collect();
        let start = parts.iter().map(|part| before.state_at(part.span_s[0])).collect::<Option<Vec<_>>>()?;
        let vehicle = Vehicle { nodes: &nodes, half_wheelbase_m: pose_path.half_wheelbase_m };
        let problem = ByBoxes { vehicle, evidence: &evidence, body, start_m, scene };
        let (states, covariances, found) = problem.solve(start)?;
        Some((Path { parts, states, covariances, ..*before }, found))
    };
    // First assume that it drove in every measured frame: the whole path determines speeds better than one second of it
    // does.
    let mut moving: Vec<bool> = observations.iter().map(|seen| !seen.detection.carried_over).collect();
    close_gaps(&mut moving, observations);
    let (drive, found) = solve(&pose_path, &moving, start_m)?;
    for (seen, moving) in observations.iter().zip(&mut moving) {
        *moving &= drive.state_at(seen.time_s)?[3].abs() >= STATIONARY_MPS;
    }
    close_gaps(&mut moving, observations);
    let (path, found) = solve(&drive, &moving, found.dims_m)?;
    let states = path.states(observations, stamps, |part| {
        let is_measured = observations[part.observations.clone()].iter().any(by_pose);
        if is_measured { part.bias(observations, path.noise) } else { Matrix3::zeros() }
    });
    Some((states, found))
}
