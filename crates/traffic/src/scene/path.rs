//! The path of a vehicle by distance, and whether the vehicle came into view or left it while it drove.

use nalgebra::Vector2;

use crate::{Clip, State, Vehicle};

/// Distance between two points of a path, m. It is well above the noise between two states.
const STEP_M: f64 = 2.0;
/// Least extent of a path, m: about two car lengths. A parked vehicle with noise stays below it.
const LEAST_M: f64 = 10.0;
/// Least extent of a path in sds of its position. Noise alone reaches it in one vehicle of 16,000 (normal distribution).
const LEAST_SDS: f64 = 4.0;
/// Speed below which a vehicle is in a queue, m/s: 5 km/h, a walking pace.
pub(super) const QUEUE_MPS: f64 = 1.4;
/// Time after which a vehicle is confirmed by the tracker, s. Vehicles that appear earlier were there before.
const CONFIRMED_S: f64 = 1.0;

/// A point of a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    /// Position, m.
    pub at: Vector2<f64>,
    /// Unit vector along the travel.
    pub forward: Vector2<f64>,
    /// Distance from the start of the path, m.
    pub along_m: f64,
    /// The state at this point.
    pub state: State,
}

/// The path of a vehicle that drives.
#[derive(Clone, Debug)]
pub(super) struct Path {
    /// Index of the clip.
    pub clip: usize,
    /// Index of the vehicle in the clip.
    pub vehicle: usize,
    /// Width of the vehicle, m.
    pub width_m: f64,
    /// Points, at least two.
    pub points: Vec<Point>,
    /// Whether the vehicle drove when its first state was taken, and was not there before for another reason.
    pub begins: bool,
    /// Whether the vehicle drove when its last state was taken, and the clip did not end.
    pub ends: bool,
}

impl Path {
    /// Returns the path of a vehicle; `None` if the vehicle does not drive.
    pub(super) fn new(clips: &[&Clip], clip: usize, vehicle: usize) -> Option<Self> {
        let source = clips[clip];
        let Vehicle { states, width_m, .. } = &source.vehicles[vehicle];
        let finite = |state: &&State| is_finite(state);
        let mut kept: Vec<State> = Vec::new();
        for state in states.iter().filter(finite) {
            if kept.last().is_none_or(|last| (state.position() - last.position()).norm() >= STEP_M) {
                kept.push(*state);
            }
        }
        let (first, last) = (kept.first()?, states.iter().rfind(finite)?);
        let start = first.position();
        let extent = kept.iter().map(|state| (state.position() - start).norm()).fold(0.0, f64::max);
        let mut sds: Vec<f32> = kept.iter().map(|state| state.own_sd_m[0].max(state.own_sd_m[1])).collect();
        sds.sort_unstable_by(f32::total_cmp);
        let sd = f64::from(sds[sds.len() / 2]);
        if kept.len() < 3 || extent < LEAST_M.max(LEAST_SDS * sd) {
            return None;
        }
        let begins = drives(states.iter().filter(finite), first.time_s) && !cut(source, first.time_s);
        let ends = drives(states.iter().rev().filter(finite), last.time_s) && !cut(source, last.time_s);
        let mut points: Vec<Point> = Vec::with_capacity(kept.len());
        for (i, state) in kept.iter().enumerate() {
            let before = kept[i.saturating_sub(1)].position();
            let after = kept[(i + 1).min(kept.len() - 1)].position();
            let along_m =
                points.last().map_or(0.0, |last| last.along_m + (state.position() - last.at).norm());
            let forward = (after - before).try_normalize(0.0).unwrap_or_else(|| state.forward());
            points.push(Point { at: state.position(), forward, along_m, state: *state });
        }
        Some(Self { clip, vehicle, width_m: *width_m, points, begins, ends })
    }

    /// Returns the length, m.
    pub(super) fn length_m(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.along_m)
    }
}

/// Whether all numbers of a state can be used.
fn is_finite(state: &State) -> bool {
    let [sd_x, sd_y] = state.own_sd_m;
    let small = [state.heading_rad, state.speed_mps, sd_x, sd_y];
    [state.x_m, state.y_m, state.time_s].iter().all(|value| value.is_finite())
        && small.iter().all(|v| v.is_finite())
}

/// Whether a vehicle drives in the second after a time, or before it. `states` begin at that time. The mean of the speeds
/// counts, and a rest that begins or ends in this second counts with its time.
fn drives<'a>(states: impl Iterator<Item = &'a State>, time_s: f64) -> bool {
    let (mut last, mut path_m, mut driven_s): (Option<&State>, f64, f64) = (None, 0.0, 0.0);
    for state in states {
        let speed = f64::from(state.speed_mps).abs();
        let Some(before) = last.replace(state) else {
            path_m = speed;
            continue;
        };
        let from_s = (before.time_s - time_s).abs();
        let step_s = (state.time_s - time_s).abs().min(1.0) - from_s;
        if from_s >= 1.0 || !before.leads_to(state) && !state.leads_to(before) {
            break;
        }
        let mean = (speed + f64::from(before.speed_mps).abs()) / 2.0;
        path_m = if driven_s == 0.0 { mean * step_s } else { path_m + mean * step_s };
        driven_s += step_s;
    }
    last.is_some() && path_m / if driven_s > 0.0 { driven_s } else { 1.0 } >= QUEUE_MPS
}

/// Whether vehicles begin or end at a time because the clip does, or because vehicles could not be followed.
fn cut(clip: &Clip, time_s: f64) -> bool {
    let [from, to] = clip.span_s;
    let near = |[from, to]: &[f64; 2]| time_s > from - CONFIRMED_S && time_s < to + CONFIRMED_S;
    time_s < from + CONFIRMED_S || time_s > to - CONFIRMED_S || clip.not_followed_s.iter().any(near)
}
