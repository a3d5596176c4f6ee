//! The path of a vehicle: nodes in the order of time, and the states that explain their detections.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Matrix5, Vector3};
use roadplane_base::{FrameStamp, GroundPose, wrap_angle};

use crate::{
    TrackState,
    box_motion::COAST_S,
    frames::Frames,
    measurement::Observation,
    noise::Noise,
    path_parts::{PathPart, path_parts, white},
    raw_track::RawTrack,
    start::{FrontChoice, start},
    stops::find_runs,
    vehicle::{Node, State, Vehicle, origin, residual},
};

/// Number of times that the noise is measured again around the smoothed path.
const NOISE_PASSES: usize = 3;

/// The path of a vehicle.
pub(crate) struct Path {
    /// Parts of the path, in the order of time.
    pub parts: Vec<PathPart>,
    /// State of each part.
    pub states: Vec<State>,
    /// Covariance of each state.
    pub covariances: Vec<Matrix5<f64>>,
    /// Split of the measurements' covariance.
    pub noise: Noise,
    /// Result of the heading disambiguation.
    pub front: FrontChoice,
    /// Distance from the rear axle to the vehicle's origin, m.
    pub half_wheelbase_m: f64,
}

impl Path {
    /// Estimates the path from measured poses; `None` where that is impossible. `times_s` holds the time of every
    /// frame.
    pub(crate) fn by_poses(track: &RawTrack, times_s: &[f64]) -> Option<Self> {
        let (observations, half_wheelbase_m) = (&track.observations, track.half_wheelbase_m());
        let runs = find_runs(observations);
        let parts = path_parts(observations, times_s, &runs);
        let (states, front) = start(observations, &parts, half_wheelbase_m);
        let noise = Noise::measured(&mut [], 0.0, 1.0);
        let mut path = Self { parts, states, covariances: Vec::new(), noise, front, half_wheelbase_m };
        path.solve(observations)?;
        for _ in 0..NOISE_PASSES {
            path.noise = path.driving_noise(observations);
            path.solve(observations)?;
        }
        Some(path)
    }

    /// Solves for the states and covariances of the nodes, from the present ones.
    fn solve(&mut self, observations: &[Observation]) -> Option<()> {
        let node = |part: &PathPart| part.node(part.measured(observations, self.noise));
        let nodes: Vec<Node> = self.parts.iter().map(node).collect();
        let vehicle = Vehicle { nodes: &nodes, half_wheelbase_m: self.half_wheelbase_m };
        (self.states, self.covariances) = vehicle.solve(std::mem::take(&mut self.states))?;
        Some(())
    }

    /// Measures the scatter of the driven part around its smoothed path. The path follows its detections, so their
    /// residuals are smaller than their errors. The share of the degrees of freedom that the path takes up corrects for
    /// this (sum of leverages).
    fn driving_noise(&self, observations: &[Observation]) -> Noise {
        let mut squares = Vec::new();
        let (mut lagged, mut leverage) = (0.0, 0.0);
        let mut before: Option<(f64, Vector3<f64>)> = None;
        for ((part, state), covariance) in self.parts.iter().zip(&self.states).zip(&self.covariances) {
            // Detections stay neighbours across frames without inference, but not across a stationary interval or a gap.
            before = before.filter(|(time_s, _)| part.parked.is_none() && part.span_s[0] - time_s <= COAST_S);
            let (None, Some(seen)) = (&part.parked, part.observation(observations)) else { continue };
            let weight = white(observations, part, seen, self.noise).try_inverse();
            let (Some(inverse), Some(weight)) = (seen.covariance.try_inverse(), weight) else { continue };
            let (pose, jacobian) = origin(state, self.half_wheelbase_m);
            leverage += (weight * jacobian * covariance * jacobian.transpose()).trace();
            let away = residual(&seen.pose, &pose);
            squares.push(away.dot(&(inverse * away)));
            lagged += before.map_or(0.0, |(_, b)| b.dot(&(inverse * away)));
            before = Some((seen.time_s, away));
        }
        let all = 3.0 * squares.len() as f64;
        let free = (1.0 - leverage / all.max(1.0)).clamp(0.2, 1.0);
        Noise::measured(&mut squares, lagged, free)
    }

    /// Returns one state for every frame. `bias` returns the covariance of the errors that the states of a node share.
    /// The node's own covariance leaves these errors out.
    pub(crate) fn states(
        &self,
        observations: &[Observation],
        stamps: &[FrameStamp],
        bias: impl Fn(&PathPart) -> Matrix3<f64>,
    ) -> Vec<TrackState> {
        let mut result = Vec::new();
        for ((part, state), covariance) in self.parts.iter().zip(&self.states).zip(&self.covariances) {
            let (pose, jacobian) = origin(state, self.half_wheelbase_m);
            let total: Matrix3<f64> = jacobian * covariance * jacobian.transpose() + bias(part);
            let mut pose_sd = total.diagonal().map(|variance| variance.max(0.0).sqrt());
            if !self.front.known {
                // Either end may be the front.
                pose_sd.z = pose_sd.z.hypot(FRAC_PI_2);
            }
            for frame in part.frames.clone() {
                let own = &observations[part.observations.clone()];
                let seen = own.binary_search_by_key(&frame, |o| o.frame).ok().map(|i| own[i].detection);
                result.push(TrackState {
                    stamp: stamps[frame],
                    pose: GroundPose { x_m: pose.x, y_m: pose.y, heading_rad: wrap_angle(pose.z) },
                    pose_sd,
                    speed_mps: if part.parked.is_some() { 0.0 } else { state[3] },
                    speed_sd_mps: covariance[(3, 3)].max(0.0).sqrt(),
                    bbox_px: seen.map(|o| o.bbox_px),
                    score: seen.map_or(0.0, |o| o.score),
                    car: seen.and_then(|o| o.car),
                });
            }
        }
        result
    }

    /// Returns the state of the node that covers a time (s), or that of the nearest node.
    pub(crate) fn state_at(&self, time_s: f64) -> Option<State> {
        let next = self.parts.partition_point(|part| part.span_s[1] < time_s);
        let away_s = |i: &usize| (self.parts[*i].span_s[0] - time_s).max(time_s - self.parts[*i].span_s[1]);
        let near = [next.saturating_sub(1), next.min(self.parts.len() - 1)];
        near.into_iter().min_by(|a, b| away_s(a).total_cmp(&away_s(b))).map(|i| self.states[i])
    }
}

/// Returns one state for every frame from the first detection to the last.
pub(crate) fn smooth_track(track: &RawTrack, frames: &Frames) -> Vec<TrackState> {
    let Some(path) = Path::by_poses(track, &frames.times_s) else { return Vec::new() };
    path.states(&track.observations, &frames.stamps, |part| part.bias(&track.observations, path.noise))
}
