//! The path of a vehicle: nodes in the order of time, and the states that explain their detections.

use nalgebra::{Matrix3, Matrix5, Vector3};

use crate::{
    box_motion::COAST_S,
    filter::MOTION_S,
    measurement::Sighting,
    noise::{Noise, VIEW_S, given_heading},
    parked::{Stand, stand},
    raw_track::RawTrack,
    start::{Facing, start},
    stops::{Run, find_runs},
    vehicle::{Node, State, Vehicle, origin, residual},
};

/// Longest step of the motion model, s. Longer gaps get nodes in between.
const MAX_STEP_S: f64 = MOTION_S / 2.0;
/// Number of times that the noise is measured again around the smoothed path.
const NOISE_PASSES: usize = 3;

/// A node of the path: one frame, one stationary interval, or a step within a gap.
pub(crate) struct Place {
    /// Range of frame indices of the tracker. It is empty for nodes that only bridge a gap in time.
    pub frames: std::ops::Range<usize>,
    /// Range of detections.
    pub sightings: std::ops::Range<usize>,
    /// Index of the detection nearest in time.
    pub nearest: usize,
    /// Pose of a stationary interval; `None` where the car drives.
    pub stand: Option<Stand>,
    /// Begin and end of the node, s.
    pub span_s: [f64; 2],
}

impl Place {
    /// Returns the measured detection of a driving car in this frame, if there is one.
    pub(crate) fn look<'a>(&self, sightings: &'a [Sighting]) -> Option<&'a Sighting> {
        sightings[self.sightings.clone()].first().filter(|seen| !seen.detection.held)
    }

    /// Returns the measured origin and heading (m, rad), with the inverse of their covariance.
    pub(crate) fn measured(
        &self,
        sightings: &[Sighting],
        noise: Noise,
    ) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        match (&self.stand, self.look(sightings)) {
            (Some(stand), _) => Some((stand.pose, stand.white.try_inverse()?)),
            (None, Some(seen)) => Some((seen.pose, white(sightings, self, seen, noise).try_inverse()?)),
            (None, None) => None,
        }
    }

    /// Returns the covariance of the errors that all detections share, m and rad.
    pub(crate) fn bias(&self, sightings: &[Sighting], noise: Noise) -> Matrix3<f64> {
        match &self.stand {
            Some(stand) => stand.bias,
            None => {
                let nearest = &sightings[self.nearest];
                given_heading(&nearest.covariance) * noise.bias(std::slice::from_ref(nearest))
            }
        }
    }
}

/// The path of a vehicle.
pub(crate) struct Way {
    /// Nodes, in the order of time.
    pub places: Vec<Place>,
    /// State of each node.
    pub nodes: Vec<State>,
    /// Covariance of each state.
    pub covariances: Vec<Matrix5<f64>>,
    /// Split of the measurements' covariance.
    pub noise: Noise,
    /// Disambiguated heading of the track.
    pub facing: Facing,
    /// Distance from the rear axle to the vehicle's origin, m.
    pub half_wheelbase_m: f64,
}

impl Way {
    /// Estimates the path from measured poses; `None` where that is impossible. `times_s` holds the time of every
    /// frame.
    pub(crate) fn by_poses(track: &RawTrack, times_s: &[f64]) -> Option<Self> {
        let (sightings, half_wheelbase_m) = (&track.observations, track.half_wheelbase_m());
        let runs = find_runs(sightings);
        let places = places(sightings, times_s, &runs);
        let (mut nodes, facing) = start(sightings, &places, half_wheelbase_m);
        let mut noise = Noise::measured(&mut [], 0.0, 0.0, 1.0);
        let mut covariances = Vec::new();
        for pass in 0..=NOISE_PASSES {
            (nodes, covariances) = solve(sightings, &places, nodes, noise, half_wheelbase_m)?;
            if pass < NOISE_PASSES {
                noise = driving_noise(sightings, &places, &nodes, &covariances, noise, half_wheelbase_m);
            }
        }
        Some(Self { places, nodes, covariances, noise, facing, half_wheelbase_m })
    }

    /// Returns the state of the node that covers a time (s), or that of the nearest node.
    pub(crate) fn state_at(&self, time_s: f64) -> Option<State> {
        let next = self.places.partition_point(|place| place.span_s[1] < time_s);
        let away_s = |i: &usize| (self.places[*i].span_s[0] - time_s).max(time_s - self.places[*i].span_s[1]);
        let near = [next.saturating_sub(1), next.min(self.places.len() - 1)];
        near.into_iter().min_by(|a, b| away_s(a).total_cmp(&away_s(b))).map(|i| self.nodes[i])
    }
}

/// Returns the nodes of a track, in the order of time. `times_s` holds the time of every frame.
pub(crate) fn places(sightings: &[Sighting], times_s: &[f64], runs: &[Run]) -> Vec<Place> {
    let mut found: Vec<Place> = Vec::new();
    for run in runs {
        let part = &sightings[run.sightings.clone()];
        let (Some(first), Some(last)) = (part.first(), part.last()) else { continue };
        // Frames since the interval before, in which the car was not detected, get nodes as well.
        let from = found.last().map_or(first.frame, |place| place.frames.end);
        let stand = if run.parked { stand(part) } else { None };
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

/// Returns the detection nearest to a time (s), of `after` and the one before it.
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

/// Solves for the states and covariances of the nodes.
fn solve(
    sightings: &[Sighting],
    places: &[Place],
    start: Vec<State>,
    noise: Noise,
    half_wheelbase_m: f64,
) -> Option<(Vec<State>, Vec<Matrix5<f64>>)> {
    let nodes: Vec<Node> = places
        .iter()
        .map(|place| Node {
            span_s: place.span_s,
            measured: place.measured(sightings, noise),
            parked: place.stand.is_some(),
        })
        .collect();
    Vehicle { nodes: &nodes, half_wheelbase_m }.solve(start)
}

/// Returns the covariance of a driving car's detection, for an estimator that assumes independent detections.
fn white(sightings: &[Sighting], place: &Place, seen: &Sighting, noise: Noise) -> Matrix3<f64> {
    let mut covariance = seen.covariance * noise.white();
    // A bias of the heading contradicts the path. So a driving car's keypoints count once per view, not once per frame.
    covariance[(2, 2)] += seen.covariance[(2, 2)] * per_view(sightings, place.nearest);
    covariance
}

/// Returns the number of detections that share a driving car's keypoint bias with this one.
pub(crate) fn per_view(sightings: &[Sighting], index: usize) -> f64 {
    let time_s = sightings[index].time_s;
    let from = sightings.partition_point(|o| o.time_s < time_s - VIEW_S / 2.0);
    let to = sightings.partition_point(|o| o.time_s <= time_s + VIEW_S / 2.0);
    sightings[from..to].iter().filter(|o| !o.detection.held).count().max(1) as f64
}

/// Measures the scatter of the driven part around its smoothed path. The path follows its detections, so their
/// residuals are smaller than their errors. The share of the degrees of freedom that the path takes up corrects for
/// this (sum of leverages).
fn driving_noise(
    sightings: &[Sighting],
    places: &[Place],
    states: &[State],
    covariances: &[Matrix5<f64>],
    used: Noise,
    half_wheelbase_m: f64,
) -> Noise {
    let mut squares = Vec::new();
    let (mut own, mut lagged, mut leverage) = (0.0, 0.0, 0.0);
    let mut before: Option<(f64, Vector3<f64>)> = None;
    for ((place, state), covariance) in places.iter().zip(states).zip(covariances) {
        // Detections stay neighbours across frames without inference, but not across a stationary interval or a gap.
        before = before.filter(|(time_s, _)| place.stand.is_none() && place.span_s[0] - time_s <= COAST_S);
        let (None, Some(seen)) = (&place.stand, place.look(sightings)) else { continue };
        let weight = white(sightings, place, seen, used).try_inverse();
        let (Some(inverse), Some(weight)) = (seen.covariance.try_inverse(), weight) else { continue };
        let (_, jacobian) = origin(state, half_wheelbase_m);
        leverage += (weight * jacobian * covariance * jacobian.transpose()).trace();
        let away = residual(state, &seen.pose, half_wheelbase_m);
        let square = away.dot(&(inverse * away));
        squares.push(square);
        own += square;
        lagged += before.map_or(0.0, |(_, b)| b.dot(&(inverse * away)));
        before = Some((seen.time_s, away));
    }
    let all = 3.0 * squares.len() as f64;
    let free = (1.0 - leverage / all.max(1.0)).clamp(0.2, 1.0);
    Noise::measured(&mut squares, own, lagged, free)
}
