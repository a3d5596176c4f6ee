//! Places the boxes that no tracklet has on the ground, as tracklets of their own.
//!
//! A chain of boxes that precedes or follows a tracklet is placed as that vehicle. Any other chain has the heading of
//! its path, if its boxes show one. Linking decides which vehicle a chain belongs to.

use nalgebra::{Matrix2, Vector2, Vector3};
use roadplane_base::{Shape, VehicleClass};
use roadplane_measure::{Body, GroundContact, HEADING_SD_RAD, Knowledge, body_of};

use crate::{
    Detection, Scene,
    expected::SURE_OVERLAP,
    filter::{MOTION_S, STATIONARY_MPS},
    frames::{BoxesByFrame, Frames},
    measurement::Observation,
    picture_chains::{Chain, chains},
    raw_track::{DimsSum, RawTrack, votes_of},
};

/// Adds tracklets, made of boxes that no given tracklet has. Boxes between the detections of a tracklet become
/// detections of it.
pub(crate) fn add_boxes(
    mut tracklets: Vec<RawTrack>,
    free: &BoxesByFrame,
    frames: &Frames,
    scene: &impl Scene,
) -> Vec<RawTrack> {
    let mut new = Vec::new();
    for chain in chains(free, &tracklets, &frames.times_s, SURE_OVERLAP) {
        let Some(index) = chain.tracklet else {
            // A single box is no chain, and weak boxes alone are no vehicle.
            if chain.boxes.len() > 1 && chain.boxes.iter().any(|(_, seen)| seen.is_sure()) {
                new.extend(alone(&chain, frames, scene));
            }
            continue;
        };
        let track = &tracklets[index];
        let ends = track.observations.first().zip(track.observations.last());
        let Some((first, last)) = ends.map(|(first, last)| (first.frame, last.frame)) else { continue };
        let (before, rest) = chain.boxes.split_at(chain.boxes.partition_point(|(frame, _)| *frame < first));
        let (between, after) = rest.split_at(rest.partition_point(|(frame, _)| *frame < last));
        // The labels of these boxes do not vote: the tracklet knows the class better.
        let part =
            |boxes| RawTrack::by_boxes(of_vehicle(boxes, track, frames, scene), &[], DimsSum::default());
        new.extend([part(before), part(after)].into_iter().flatten());
        let found = of_vehicle(between, track, frames, scene);
        tracklets[index].insert(&found);
    }
    tracklets.extend(new);
    tracklets
}

/// Places boxes on the ground as those of the tracklet's vehicle.
fn of_vehicle(
    boxes: &[(usize, Detection)],
    track: &RawTrack,
    frames: &Frames,
    scene: &impl Scene,
) -> Vec<Observation> {
    let body = body(track.class(), track.dims_m(), &track.shape.fused().mean, scene);
    let places: Vec<[f64; 3]> =
        track.observations.iter().map(|seen| [seen.time_s, seen.pose.x, seen.pose.y]).collect();
    let heading = |time_s: f64| {
        let near = nearest(&track.observations, time_s, |seen| seen.time_s)?;
        let driven = direction(&places, near.time_s).map(|travel| [travel, HEADING_SD_RAD]);
        Some(driven.unwrap_or([near.pose.z, near.covariance[(2, 2)].sqrt()]))
    };
    observations(boxes, &body, heading, frames, scene)
}

/// Returns the body of a vehicle: its size is `dims_m` (m) where that is given, else that of its class, for cars with this
/// shape. One box shows the size no better than the class does, so the covariance is that of the class.
fn body(class: VehicleClass, dims_m: Option<Vector3<f64>>, shape: &Shape, scene: &impl Scene) -> Body {
    Body { dims_m: dims_m.unwrap_or_else(|| scene.body(class, shape).dims_m), ..body_of(class) }
}

/// Returns the tracklet of a chain without a tracklet; `None` where the camera cannot see it on the ground.
fn alone(chain: &Chain, frames: &Frames, scene: &impl Scene) -> Option<RawTrack> {
    let boxes = &chain.boxes;
    let class = VehicleClass::ALL[votes_of(boxes).imax()];
    let label = Knowledge::Label(class);
    let about: Vec<(&(usize, Detection), GroundContact)> = (boxes.iter())
        .filter_map(|one| Some((one, scene.place(&frames.stamps[one.0], &one.1, &label)?)))
        .filter(|(_, at)| at.covariance.cholesky().is_some())
        .collect();
    let time_s = |frame: usize| frames.times_s[frame];
    let places: Vec<[f64; 3]> =
        about.iter().map(|((frame, _), at)| [time_s(*frame), at.pose.x_m, at.pose.y_m]).collect();
    // The box of a stationary car shows its heading, if only roughly. Positions that jitter are no path.
    let direction_at = |at: &[f64; 3]| Some([at[0], direction(&places, at[0])?]);
    let directions: Vec<[f64; 2]> =
        if chain.goes_on() { places.iter().filter_map(direction_at).collect() } else { Vec::new() };
    let dims = DimsSum::of(about.iter().map(|(_, at)| &at.dims_m));
    if directions.is_empty() {
        let observation = |((frame, seen), at): &(&(usize, Detection), GroundContact)| {
            Observation::by_box(seen, at, *frame, time_s(*frame))
        };
        return RawTrack::by_boxes(about.iter().map(observation).collect(), boxes, dims);
    }
    let dims_m = if class == VehicleClass::Car { None } else { dims.mean() };
    let body = body(class, dims_m, &Shape::zeros(), scene);
    let heading = |time_s: f64| {
        let [_, travel] = *nearest(&directions, time_s, |travel| travel[0])?;
        Some([travel, HEADING_SD_RAD])
    };
    RawTrack::by_boxes(observations(boxes, &body, heading, frames, scene), boxes, dims)
}

/// Places boxes of a vehicle on the ground. `heading` returns its heading at a time (s) and the sd of the heading, rad.
fn observations(
    boxes: &[(usize, Detection)],
    body: &Body,
    heading: impl Fn(f64) -> Option<[f64; 2]>,
    frames: &Frames,
    scene: &impl Scene,
) -> Vec<Observation> {
    let of_box = |(frame, seen): &(usize, Detection)| {
        let time_s = frames.times_s[*frame];
        let [heading_rad, heading_sd_rad] = heading(time_s)?;
        let known = Knowledge::Track { body: *body, heading_rad, heading_sd_rad };
        let placed = scene.place(&frames.stamps[*frame], seen, &known);
        let placed = placed.filter(|at| at.covariance.cholesky().is_some())?;
        Some(Observation::by_box(seen, &placed, *frame, time_s))
    };
    boxes.iter().filter_map(of_box).collect()
}

/// Returns the item whose time is nearest to `time_s`, s.
fn nearest<T>(items: &[T], time_s: f64, at_s: impl Fn(&T) -> f64) -> Option<&T> {
    let away_s = |item: &T| (at_s(item) - time_s).abs();
    items.iter().min_by(|a, b| away_s(a).total_cmp(&away_s(b)))
}

/// Returns the direction of travel at a time, rad: that of a line through the positions (time, x, y) around it. `None`
/// where the vehicle is too slow.
fn direction(places: &[[f64; 3]], at_s: f64) -> Option<f64> {
    let (mut normal, mut right) = (Matrix2::zeros(), [Vector2::zeros(), Vector2::zeros()]);
    for [time_s, x, y] in places.iter().filter(|place| (place[0] - at_s).abs() <= MOTION_S) {
        let basis = Vector2::new(1.0, time_s - at_s);
        normal += basis * basis.transpose();
        right[0] += basis * *x;
        right[1] += basis * *y;
    }
    let line = normal.cholesky()?;
    let [x, y] = right.map(|right| line.solve(&right).y);
    (x.hypot(y) > STATIONARY_MPS).then(|| y.atan2(x))
}
