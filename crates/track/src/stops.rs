//! Divides a track into stationary and driving intervals. A car drives where its position on the ground and its box in
//! the image both move by more than their noise. The motion is measured over about one second. Poses jitter, and boxes
//! change when something passes in front, but both rarely happen together.

use std::ops::Range;

use nalgebra::Vector2;
use roadplane_base::{bbox_centre, upper_median};

use crate::{
    filter::{MOTION_S, STILL_M},
    measurement::Observation,
    noise::{MIN_DETECTIONS, SIGNIFICANT},
};

/// Consecutive detections, all driving or all stationary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    /// Indices of the detections.
    pub observations: Range<usize>,
    /// Whether the car is stationary.
    pub parked: bool,
}

/// Divides a track's detections, in the order of time. A track without noticeable motion is one stationary interval.
pub(crate) fn find_runs(observations: &[Observation]) -> Vec<Run> {
    let moves_at = |i| moves(window(observations, i));
    let mut moving: Vec<bool> = (0..observations.len()).map(moves_at).collect();
    close_gaps(&mut moving, observations);
    // A stationary interval that creeps as a whole is slow driving.
    for run in runs(&moving).into_iter().filter(|run| run.parked) {
        let part = &observations[run.observations.clone()];
        if moves(part) {
            moving[run.observations].fill(true);
        }
    }
    runs(&moving)
}

/// Returns the detections within half of [`MOTION_S`] of one. Where a car is rarely detected, a longer time is taken,
/// so that it holds [`MIN_DETECTIONS`].
fn window(observations: &[Observation], middle: usize) -> &[Observation] {
    let time_s = observations[middle].time_s;
    let mut from = observations.partition_point(|o| o.time_s < time_s - MOTION_S / 2.0);
    let mut to = observations.partition_point(|o| o.time_s <= time_s + MOTION_S / 2.0);
    let gap_s = |i: usize| observations.get(i).map_or(f64::INFINITY, |o| (o.time_s - time_s).abs());
    while to - from < MIN_DETECTIONS.min(observations.len()) {
        if from > 0 && gap_s(from - 1) <= gap_s(to) {
            from -= 1;
        } else {
            to += 1;
        }
    }
    &observations[from..to]
}

/// Whether the detections move by more than [`STILL_M`] on the ground, and by more than noise there and in the image. Their
/// motion is that of a straight line through them.
fn moves(part: &[Observation]) -> bool {
    let goes_at = |at: &dyn Fn(&Observation) -> Vector2<f64>, least: f64| {
        goes(&part.iter().map(|o| (o.time_s, at(o))).collect::<Vec<_>>(), least)
    };
    // When a car drives along the line of sight, its box stays and grows. So the corners are compared, and not only the
    // centre.
    let corner_goes =
        |x: usize, y: usize| goes_at(&|o| Vector2::new(o.detection.bbox_px[x], o.detection.bbox_px[y]), 0.0);
    goes_at(&|o| o.pose.xy(), STILL_M)
        && (goes_at(&|o| bbox_centre(&o.detection.bbox_px), 0.0) || (corner_goes(0, 1) && corner_goes(2, 3)))
}

/// Whether a line through (time, position) is longer than `least` and significant. It is a least-squares fit with one
/// round of trimming.
fn goes(points: &[(f64, Vector2<f64>)], least: f64) -> bool {
    let Some((slope, sd, span)) = line(points) else { return false };
    let length = slope.norm() * span;
    length > least && length > SIGNIFICANT * sd * span
}

/// Returns the slope of the line, the sd of the slope (in its largest direction) and the duration in s. `None` for
/// fewer than four points.
fn line(points: &[(f64, Vector2<f64>)]) -> Option<(Vector2<f64>, f64, f64)> {
    let fit = |points: &[(f64, Vector2<f64>)]| {
        let n = points.len() as f64;
        let time = points.iter().map(|p| p.0).sum::<f64>() / n;
        let place = points.iter().map(|p| p.1).sum::<Vector2<f64>>() / n;
        let spread: f64 = points.iter().map(|p| (p.0 - time).powi(2)).sum();
        let slope = points.iter().map(|p| (p.1 - place) * (p.0 - time)).sum::<Vector2<f64>>() / spread;
        let residuals: Vec<f64> =
            points.iter().map(|p| (p.1 - place - slope * (p.0 - time)).norm()).collect();
        (slope, spread, residuals)
    };
    if points.len() < 4 {
        return None;
    }
    let (_, _, residuals) = fit(points);
    let bound = 4.0 * upper_median(&mut residuals.clone(), f64::total_cmp)? + 1e-9;
    let trimmed: Vec<(f64, Vector2<f64>)> =
        points.iter().zip(&residuals).filter(|(_, r)| **r <= bound).map(|(p, _)| *p).collect();
    if trimmed.len() < 4 {
        return None;
    }
    let (slope, spread, residuals) = fit(&trimmed);
    let span = trimmed.last()?.0 - trimmed.first()?.0;
    let scatter = residuals.iter().map(|r| r * r).sum::<f64>() / (trimmed.len() as f64 - 2.0);
    (spread > 0.0).then(|| (slope, (scatter / spread).sqrt(), span))
}

/// Groups detections into intervals that move and intervals that do not.
pub(crate) fn runs(moving: &[bool]) -> Vec<Run> {
    let mut found = Vec::new();
    let mut from = 0;
    for chunk in moving.chunk_by(|a, b| a == b) {
        found.push(Run { observations: from..from + chunk.len(), parked: !chunk[0] });
        from += chunk.len();
    }
    found
}

/// Turns stationary intervals shorter than [`MOTION_S`] into driving, as they cannot be measured. A track that never
/// drives is unchanged. At an end of the track, a short stop looks like driving that is hardly visible yet.
pub(crate) fn close_gaps(moving: &mut [bool], observations: &[Observation]) {
    let found = runs(moving);
    for run in found.iter().filter(|_| found.len() > 1) {
        let (first, last) = (&observations[run.observations.start], &observations[run.observations.end - 1]);
        if run.parked && last.time_s - first.time_s < MOTION_S {
            moving[run.observations.clone()].fill(true);
        }
    }
}
