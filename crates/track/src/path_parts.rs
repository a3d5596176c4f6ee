//! The parts of a vehicle's path, at each of which its state is estimated: frames, stationary intervals, and steps
//! within gaps.

use nalgebra::{Matrix3, Vector3};

use crate::{
    filter::MOTION_S,
    measurement::Observation,
    noise::{Noise, VIEW_S, given_heading},
    parked::{ParkedPose, parked_pose},
    stops::Run,
    vehicle::Node,
};

/// Longest step of the motion model, s. Longer gaps get nodes in between.
const MAX_STEP_S: f64 = MOTION_S / 2.0;

/// A part of the path: one frame, one stationary interval, or a step within a gap.
pub(crate) struct PathPart {
    /// Range of frame indices of the tracker. It is empty for parts that only bridge a gap in time.
    pub frames: std::ops::Range<usize>,
    /// Range of the track's observations.
    pub observations: std::ops::Range<usize>,
    /// Index of the detection nearest in time.
    pub nearest: usize,
    /// Pose of a stationary interval; `None` where the car drives.
    pub parked: Option<ParkedPose>,
    /// Begin and end of the part, s.
    pub span_s: [f64; 2],
}

impl PathPart {
    /// Returns the observation of a driving car in this frame; `None` if there is none, or if it is carried over.
    pub(crate) fn observation<'a>(&self, observations: &'a [Observation]) -> Option<&'a Observation> {
        observations[self.observations.clone()].first().filter(|seen| !seen.detection.carried_over)
    }

    /// Returns the measured origin and heading (m, rad), with the inverse of their covariance.
    pub(crate) fn measured(
        &self,
        observations: &[Observation],
        noise: Noise,
    ) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        match (&self.parked, self.observation(observations)) {
            (Some(parked), _) => Some((parked.pose, parked.white.try_inverse()?)),
            (None, Some(seen)) => Some((seen.pose, white(observations, self, seen, noise).try_inverse()?)),
            (None, None) => None,
        }
    }

    /// Returns the node of the motion model, with this measurement.
    pub(crate) fn node(&self, measured: Option<(Vector3<f64>, Matrix3<f64>)>) -> Node {
        Node { span_s: self.span_s, measured, parked: self.parked.is_some() }
    }

    /// Returns the covariance of the errors that all detections share, m and rad.
    pub(crate) fn bias(&self, observations: &[Observation], noise: Noise) -> Matrix3<f64> {
        match &self.parked {
            Some(parked) => parked.bias,
            None => {
                let nearest = &observations[self.nearest];
                given_heading(&nearest.covariance) * noise.bias(std::slice::from_ref(nearest))
            }
        }
    }
}

/// Returns the parts of a track's path, in the order of time. `times_s` holds the time of every frame.
pub(crate) fn path_parts(observations: &[Observation], times_s: &[f64], runs: &[Run]) -> Vec<PathPart> {
    let mut found: Vec<PathPart> = Vec::new();
    for run in runs {
        let own = &observations[run.observations.clone()];
        let (Some(first), Some(last)) = (own.first(), own.last()) else { continue };
        // Frames since the interval before, in which the car was not detected, get parts as well.
        let from = found.last().map_or(first.frame, |part| part.frames.end);
        let parked = if run.parked { parked_pose(own) } else { None };
        let mut index = run.observations.start;
        for (frame, &time_s) in times_s.iter().enumerate().take(last.frame + 1).skip(from) {
            if frame >= first.frame && parked.is_some() {
                break;
            }
            let seen = observations.get(index).is_some_and(|o| o.frame == frame);
            found.push(PathPart {
                frames: frame..frame + 1,
                observations: if seen { index..index + 1 } else { index..index },
                nearest: nearest(observations, index, time_s),
                parked: None,
                span_s: [time_s, time_s],
            });
            index += usize::from(seen);
        }
        if parked.is_some() {
            found.push(PathPart {
                frames: first.frame..last.frame + 1,
                observations: run.observations.clone(),
                nearest: run.observations.start,
                parked,
                span_s: [first.time_s, last.time_s],
            });
        }
    }
    bridged(found)
}

/// Returns the detection nearest to a time (s), of `after` and the one before it.
fn nearest(observations: &[Observation], after: usize, time_s: f64) -> usize {
    let gap_s = |i: usize| observations.get(i).map_or(f64::INFINITY, |o| (o.time_s - time_s).abs());
    let before = after.saturating_sub(1);
    if gap_s(before) < gap_s(after) { before } else { after }
}

/// Puts parts without frames into long gaps.
fn bridged(parts: Vec<PathPart>) -> Vec<PathPart> {
    let mut result: Vec<PathPart> = Vec::with_capacity(parts.len());
    for part in parts {
        if let Some(before) = result.last() {
            let (from_s, gap_s) = (before.span_s[1], part.span_s[0] - before.span_s[1]);
            let steps = (gap_s / MAX_STEP_S).ceil().clamp(1.0, 1000.0) as usize;
            let (frame, index, nearest) = (part.frames.start, part.observations.start, part.nearest);
            result.extend((1..steps).map(|i| {
                let time_s = from_s + gap_s * i as f64 / steps as f64;
                let span_s = [time_s, time_s];
                PathPart { frames: frame..frame, observations: index..index, nearest, parked: None, span_s }
            }));
        }
        result.push(part);
    }
    result
}

/// Returns the covariance of a driving car's detection, for an estimator that assumes independent detections.
pub(crate) fn white(
    observations: &[Observation],
    part: &PathPart,
    seen: &Observation,
    noise: Noise,
) -> Matrix3<f64> {
    let mut covariance = seen.covariance * noise.white();
    // A bias of the heading contradicts the path. So a driving car's keypoints count once per view, not once per frame.
    covariance[(2, 2)] += seen.covariance[(2, 2)] * per_view(observations, part.nearest);
    covariance
}

/// Returns the number of detections that share a driving car's keypoint bias with this one.
pub(crate) fn per_view(observations: &[Observation], index: usize) -> f64 {
    let time_s = observations[index].time_s;
    let from = observations.partition_point(|o| o.time_s < time_s - VIEW_S / 2.0);
    let to = observations.partition_point(|o| o.time_s <= time_s + VIEW_S / 2.0);
    observations[from..to].iter().filter(|o| !o.detection.carried_over).count().max(1) as f64
}
