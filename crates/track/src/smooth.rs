//! Sightings of a track → its states.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Matrix5, Vector3};
use roadplane_base::{FrameStamp, GroundPose, VehicleClass, fold_axis, wrap_angle};

use crate::{
    Scene, TrackOptions, TrackState,
    by_boxes::{Body, ByBoxes, Look},
    facing::{Facing, facing},
    measurement::Sighting,
    noise::{Noise, given_heading},
    parked::{Stand, stand},
    stops::{Run, find_runs},
    vehicle::{Node, State, Vehicle, origin, residual, state_at},
};

/// Longest step of the vehicle model, s; longer gaps get nodes in between.
const MAX_STEP_S: f64 = 0.25;
/// Time over which a driving car's keypoint bias stays the same, s: until it is seen from elsewhere.
const BIAS_S: f64 = 2.0;

/// Sightings farther apart than this have no common error that shows from one to the next, s.
const NEIGHBOURS_S: f64 = 0.4;

/// Times that the noise is measured anew around the smoothed path.
const NOISE_PASSES: usize = 3;

/// Half of the time over which a way is taken for straight, s; longer for what only its box places, as that says less of its axis.
const WAY_S: f64 = 0.5;
const BOX_WAY_S: f64 = 2.0;

/// Slower than this a vehicle that is placed by its boxes stands, m/s; for shorter it does not, s.
const STANDING_MPS: f64 = 0.3;
const MIN_STAND_S: f64 = 1.0;

/// What a node stands for.
struct Place {
    /// Frames, counted as the tracker does; empty for nodes that only bridge a gap in time.
    frames: std::ops::Range<usize>,
    /// Sightings.
    sightings: std::ops::Range<usize>,
    /// Sighting nearest in time.
    nearest: usize,
    stand: Option<Stand>,
    span_s: [f64; 2],
}

impl Place {
    /// The look at a driving car in this frame, if it was measured in it.
    fn look<'a>(&self, sightings: &'a [Sighting]) -> Option<&'a Sighting> {
        sightings[self.sightings.clone()].first().filter(|seen| !seen.held)
    }

    /// Origin and heading as they were seen, with the inverse of their covariance.
    fn measured(&self, sightings: &[Sighting], noise: Noise) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        match (&self.stand, self.look(sightings)) {
            (Some(stand), _) => Some((stand.pose, stand.white.try_inverse()?)),
            (None, Some(seen)) => Some((seen.pose, white(sightings, self, seen, noise).try_inverse()?)),
            (None, None) => None,
        }
    }

    /// What errors of it are shared by all looks.
    fn bias(&self, sightings: &[Sighting], noise: Noise) -> Matrix3<f64> {
        match &self.stand {
            Some(stand) => stand.bias,
            None => given_heading(&sightings[self.nearest].covariance) * noise.bias(),
        }
    }
}

/// States for every frame from the first sighting to the last.
pub(crate) fn smooth_track(
    sightings: &[Sighting],
    stamps: &[FrameStamp],
    times_s: &[f64],
    options: &TrackOptions,
) -> Vec<TrackState> {
    let Some(way) = Way::by_poses(sightings, times_s, options) else { return Vec::new() };
    way.states(sightings, stamps, options, |place| place.bias(sightings, way.noise))
}

/// The same of a vehicle that boxes place where keypoints do not, always if it is no car, with its length, width and height (m), and their
/// covariance. `None` where nothing is left to boxes, or they do not say how it was turned as it did not drive, or do not go together with its way.
pub(crate) fn smooth_by_boxes(
    sightings: &[Sighting],
    stamps: &[FrameStamp],
    times_s: &[f64],
    options: &TrackOptions,
    body: &Body,
    scene: &impl Scene,
) -> Option<(Vec<TrackState>, (Vector3<f64>, Matrix3<f64>))> {
    let by_box = |seen: &Sighting| seen.from_box || body.class != VehicleClass::Car;
    let (boxes, poses): (Vec<&Sighting>, Vec<&Sighting>) =
        sightings.iter().filter(|seen| !seen.held).partition(|seen| by_box(seen));
    let by_poses = Way::by_poses(sightings, times_s, options)
        .filter(|way| !boxes.is_empty() && (way.facing.drove || !poses.is_empty()))?;
    let solve = |before: &Way, stands: &[bool], start_m: Vector3<f64>| {
        let mut places = places(sightings, times_s, &runs(stands), options);
        let measured = |place: &mut Place| {
            let seen = &sightings[place.sightings.clone()];
            let poses: Vec<Sighting> =
                seen.iter().filter(|seen| !seen.held && !by_box(seen)).cloned().collect();
            if poses.is_empty() {
                return None;
            }
            if place.stand.is_some() {
                place.stand = stand(&poses, options.bias_share);
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
        let body = Body { start_m, ..*body };
        let solved = ByBoxes { nodes: &nodes, looks: &looks, body: &body, scene, options }.solve(start)?;
        let way = Way { places, nodes: solved.states, covariances: solved.covariances, ..*before };
        Some((way, solved.dims_m, solved.dims_covariance))
    };
    // First as if it drove wherever it was looked at: what the whole way says of speeds is more than what a second of it does.
    let mut stands: Vec<bool> = sightings.iter().map(|seen| seen.held).collect();
    drop_short(&mut stands, sightings);
    let (drive, dims_m, _) = solve(&by_poses, &stands, body.start_m)?;
    for (seen, stands) in sightings.iter().zip(&mut stands) {
        *stands |= drive.state_at(seen.time_s)?[3].abs() < STANDING_MPS;
    }
    drop_short(&mut stands, sightings);
    let (way, dims_m, covariance) = solve(&drive, &stands, dims_m)?;
    let states = way.states(sightings, stamps, options, |place| {
        let is_measured = sightings[place.sightings.clone()].iter().any(|seen| !seen.held && !by_box(seen));
        if is_measured { place.bias(sightings, way.noise) } else { Matrix3::zeros() }
    });
    Some((states, (dims_m, covariance)))
}

/// Stands too short to be some are none.
fn drop_short(stands: &mut [bool], sightings: &[Sighting]) {
    for run in runs(stands) {
        let part = &sightings[run.sightings.clone()];
        if part[part.len() - 1].time_s - part[0].time_s < MIN_STAND_S {
            stands[run.sightings].fill(false);
        }
    }
}

/// Runs of what stands and what does not.
fn runs(stands: &[bool]) -> Vec<Run> {
    let mut from = 0;
    let mut run = |part: &[bool]| {
        let sightings = from..from + part.len();
        from = sightings.end;
        Run { sightings, parked: part[0] }
    };
    stands.chunk_by(|a, b| a == b).map(&mut run).collect()
}

/// How a vehicle went.
struct Way {
    places: Vec<Place>,
    nodes: Vec<State>,
    covariances: Vec<Matrix5<f64>>,
    noise: Noise,
    facing: Facing,
}

impl Way {
    fn by_poses(sightings: &[Sighting], times_s: &[f64], options: &TrackOptions) -> Option<Self> {
        let runs = find_runs(sightings, options);
        let places = places(sightings, times_s, &runs, options);
        let (mut nodes, facing) = start(sightings, &places, options);
        let mut noise = Noise::measured(&mut [], 0.0, 0.0, 1.0, options.bias_share);
        let mut covariances = Vec::new();
        for pass in 0..=NOISE_PASSES {
            (nodes, covariances) = solve(sightings, &places, nodes, noise, options)?;
            if pass < NOISE_PASSES {
                noise = driving_noise(sightings, &places, &nodes, &covariances, noise, options);
            }
        }
        Some(Self { places, nodes, covariances, noise, facing })
    }

    /// Of the node that lasts at a time, or that nearest to it.
    fn state_at(&self, time_s: f64) -> Option<State> {
        let next = self.places.partition_point(|place| place.span_s[1] < time_s);
        let away_s = |i: &usize| (self.places[*i].span_s[0] - time_s).max(time_s - self.places[*i].span_s[1]);
        let near = [next.saturating_sub(1), next.min(self.places.len() - 1)];
        near.into_iter().min_by(|a, b| away_s(a).total_cmp(&away_s(b))).map(|i| self.nodes[i])
    }

    /// For every frame. `bias`: what errors of a place its states share, which their covariances leave out.
    fn states(
        &self,
        sightings: &[Sighting],
        stamps: &[FrameStamp],
        options: &TrackOptions,
        bias: impl Fn(&Place) -> Matrix3<f64>,
    ) -> Vec<TrackState> {
        let mut result = Vec::new();
        for ((place, state), covariance) in self.places.iter().zip(&self.nodes).zip(&self.covariances) {
            let mut smoothed = Smoothed::new(place, state, covariance, &bias(place), options);
            if !self.facing.known {
                // Either end may be the front.
                smoothed.pose_sd.z = smoothed.pose_sd.z.hypot(FRAC_PI_2);
            }
            for frame in place.frames.clone() {
                let own = &sightings[place.sightings.clone()];
                let seen = own.binary_search_by_key(&frame, |o| o.frame).ok().map(|i| &own[i]);
                result.push(smoothed.at(stamps[frame], seen));
            }
        }
        result
    }
}

/// Nodes of a track, in the order of time.
fn places(sightings: &[Sighting], times_s: &[f64], runs: &[Run], options: &TrackOptions) -> Vec<Place> {
    let mut found: Vec<Place> = Vec::new();
    for run in runs {
        let part = &sightings[run.sightings.clone()];
        let (Some(first), Some(last)) = (part.first(), part.last()) else { continue };
        // Frames since the run before, in which the car was not seen.
        let from = found.last().map_or(first.frame, |place| place.frames.end);
        let stand = if run.parked { stand(part, options.bias_share) } else { None };
        let mut index = run.sightings.start;
        for (frame, &time_s) in times_s.iter().enumerate().take(last.frame + 1).skip(from) {
            if frame >= first.frame && stand.is_some() {
                break;
            }
            let seen = sightings.get(index).is_some_and(|o| o.frame == frame);
            found.push(Place {
                frames: frame..frame + 1,
                sightings: if seen { index..index + 1 } else { index..index },
                nearest: nearest(sightings, index, time_s),
                stand: None,
                span_s: [time_s, time_s],
            });
            index += usize::from(seen);
        }
        if stand.is_some() {
            found.push(Place {
                frames: first.frame..last.frame + 1,
                sightings: run.sightings.clone(),
                nearest: run.sightings.start,
                stand,
                span_s: [first.time_s, last.time_s],
            });
        }
    }
    bridged(found)
}

fn nearest(sightings: &[Sighting], after: usize, time_s: f64) -> usize {
    let gap_s = |i: usize| sightings.get(i).map_or(f64::INFINITY, |o| (o.time_s - time_s).abs());
    let before = after.saturating_sub(1);
    if gap_s(before) < gap_s(after) { before } else { after }
}

/// Puts nodes without frames into long gaps.
fn bridged(places: Vec<Place>) -> Vec<Place> {
    let mut result: Vec<Place> = Vec::with_capacity(places.len());
    for place in places {
        if let Some(before) = result.last() {
            let (from_s, gap_s) = (before.span_s[1], place.span_s[0] - before.span_s[1]);
            let steps = (gap_s / MAX_STEP_S).ceil().clamp(1.0, 1000.0) as usize;
            let (frame, index, nearest) = (place.frames.start, place.sightings.start, place.nearest);
            result.extend((1..steps).map(|i| {
                let time_s = from_s + gap_s * i as f64 / steps as f64;
                let span_s = [time_s, time_s];
                Place { frames: frame..frame, sightings: index..index, nearest, stand: None, span_s }
            }));
        }
        result.push(place);
    }
    result
}

/// Where to start from: places as seen, a little averaged; the axis by motion where there is some, else by keypoints; the
/// front by both; and what told it.
fn start(sightings: &[Sighting], places: &[Place], options: &TrackOptions) -> (Vec<State>, Facing) {
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
            state_at(&pose, speed, options.half_wheelbase_m)
        })
        .collect();
    (states, facing)
}

/// An axis for each sighting, turned by less than π/2 from the one before: the way where there is one, else what was seen. What was
/// seen by its box only, which says little of it, has that of the way nearest in time.
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

/// Direction of travel around a sighting where it is clear.
fn way_at(sightings: &[Sighting], averaged: &[Vector3<f64>], i: usize) -> Option<f64> {
    let time_s = sightings[i].time_s;
    let sd = sightings[i].covariance.fixed_view::<2, 2>(0, 0).trace().sqrt();
    let longest_s = if sightings[i].from_box { BOX_WAY_S } else { WAY_S };
    let mut within_s = WAY_S;
    while within_s <= longest_s {
        let from = sightings.partition_point(|o| o.time_s < time_s - within_s).min(i);
        let to = sightings.partition_point(|o| o.time_s <= time_s + within_s).max(i + 1) - 1;
        let way = averaged[to].xy() - averaged[from].xy();
        if way.norm() > 1.0 + sd {
            return Some(way.y.atan2(way.x));
        }
        within_s *= 2.0;
    }
    None
}

/// Pose and speed for a node, on the straight line between the sightings around it.
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
    let ahead = way.dot(&nalgebra::Vector2::new(heading.cos(), heading.sin()));
    let speed = if place.stand.is_some() || long_s <= 0.0 { 0.0 } else { ahead / long_s };
    (Vector3::new(centre.x, centre.y, heading), speed)
}

fn solve(
    sightings: &[Sighting],
    places: &[Place],
    start: Vec<State>,
    noise: Noise,
    options: &TrackOptions,
) -> Option<(Vec<State>, Vec<Matrix5<f64>>)> {
    let nodes: Vec<Node> = places
        .iter()
        .map(|place| Node {
            span_s: place.span_s,
            measured: place.measured(sightings, noise),
            parked: place.stand.is_some(),
        })
        .collect();
    Vehicle { nodes: &nodes, options }.solve(start)
}

/// Covariance of a driving car's sighting in an estimator that takes sightings for independent.
fn white(sightings: &[Sighting], place: &Place, seen: &Sighting, noise: Noise) -> Matrix3<f64> {
    let mut covariance = seen.covariance * noise.white();
    // A bias of the heading contradicts the path, so a driving car's keypoints count once per view, not per frame.
    covariance[(2, 2)] += seen.covariance[(2, 2)] * noise.bias() * per_view(sightings, place.nearest);
    covariance
}

/// Sightings that share a driving car's keypoint bias.
fn per_view(sightings: &[Sighting], index: usize) -> f64 {
    let time_s = sightings[index].time_s;
    let from = sightings.partition_point(|o| o.time_s < time_s - BIAS_S / 2.0);
    let to = sightings.partition_point(|o| o.time_s <= time_s + BIAS_S / 2.0);
    sightings[from..to].iter().filter(|o| !o.held).count().max(1) as f64
}

/// Scatter of the driven part around its smoothed path. The path bends towards its sightings, so their residuals are
/// smaller than their errors: by the share of the degrees of freedom that the path takes up (the sum of leverages).
fn driving_noise(
    sightings: &[Sighting],
    places: &[Place],
    states: &[State],
    covariances: &[Matrix5<f64>],
    used: Noise,
    options: &TrackOptions,
) -> Noise {
    let mut squares = Vec::new();
    let (mut own, mut lagged, mut leverage) = (0.0, 0.0, 0.0);
    let mut before: Option<(f64, Vector3<f64>)> = None;
    for ((place, state), covariance) in places.iter().zip(states).zip(covariances) {
        // Sightings are neighbours across frames that nobody looked at, not across a stand or a gap.
        before =
            before.filter(|(time_s, _)| place.stand.is_none() && place.span_s[0] - time_s <= NEIGHBOURS_S);
        let (None, Some(seen)) = (&place.stand, place.look(sightings)) else { continue };
        let weight = white(sightings, place, seen, used).try_inverse();
        let (Some(inverse), Some(weight)) = (seen.covariance.try_inverse(), weight) else { continue };
        let (_, jacobian) = origin(state, options.half_wheelbase_m);
        leverage += (weight * jacobian * covariance * jacobian.transpose()).trace();
        let away = residual(state, &seen.pose, options.half_wheelbase_m);
        let square = away.dot(&(inverse * away));
        squares.push(square);
        own += square;
        lagged += before.map_or(0.0, |(_, b)| b.dot(&(inverse * away)));
        before = Some((seen.time_s, away));
    }
    let all = 3.0 * squares.len() as f64;
    let free = (1.0 - leverage / all.max(1.0)).clamp(0.2, 1.0);
    Noise::measured(&mut squares, own, lagged, free, options.bias_share)
}

/// A node's state as the track shows it.
struct Smoothed {
    pose: GroundPose,
    pose_sd: Vector3<f64>,
    speed_mps: f64,
    speed_sd_mps: f64,
}

impl Smoothed {
    fn new(
        place: &Place,
        state: &State,
        covariance: &Matrix5<f64>,
        bias: &Matrix3<f64>,
        options: &TrackOptions,
    ) -> Self {
        let (pose, jacobian) = origin(state, options.half_wheelbase_m);
        let white = jacobian * covariance * jacobian.transpose();
        let total: Matrix3<f64> = white + bias;
        let standing = place.stand.is_some();
        Self {
            pose: GroundPose { x_m: pose.x, y_m: pose.y, heading_rad: wrap_angle(pose.z) },
            pose_sd: total.diagonal().map(|variance| variance.max(0.0).sqrt()),
            speed_mps: if standing { 0.0 } else { state[3] },
            speed_sd_mps: covariance[(3, 3)].max(0.0).sqrt(),
        }
    }

    fn at(&self, stamp: FrameStamp, seen: Option<&Sighting>) -> TrackState {
        TrackState {
            stamp,
            observed: seen.is_some(),
            held: seen.is_some_and(|o| o.held),
            pose: self.pose,
            pose_sd: self.pose_sd,
            speed_mps: self.speed_mps,
            speed_sd_mps: self.speed_sd_mps,
            bbox_px: seen.map(|o| o.bbox_px),
            score: seen.map_or(0.0, |o| o.score),
            car: seen.and_then(|o| o.car),
            hidden: seen.is_some_and(|o| o.hidden.contains(&true)),
        }
    }
}
