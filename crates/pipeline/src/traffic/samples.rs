//! Samples of a table → vehicles with states.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::{GroundPose, VehicleClass};
use roadplane_measure::body_of;
use roadplane_traffic::{State, Vehicle};
use roadplane_write::TrackSample;

use super::world::World;

/// Shortest time between two states of a vehicle, s. More states change no figure, but need memory.
const LEAST_STEP_S: f64 = 0.095;
/// Time between two computations of the scale's sd along a path, s.
const SCALE_STEP_S: f64 = 1.0;

/// Vehicles in the making, by segment and track.
#[derive(Default)]
pub(super) struct Vehicles {
    tracks: BTreeMap<(usize, u64), Track>,
    /// Whether a sample has no sds.
    pub(super) lack_sds: bool,
    /// Times of the first and the last sample, s.
    pub(super) span_s: Option<[f64; 2]>,
    /// Local time of the clip's time 0, s.
    pub(super) start_local_s: Option<f64>,
    /// Whether the samples of a track are not in the order of time.
    pub(super) is_unsorted: bool,
}

struct Track {
    vehicle: Vehicle,
    /// Distance from the vehicle's origin forward to the centre of its body, m.
    centre_m: f64,
    has_motion: bool,
    scale_at_s: f64,
    last: TrackSample,
}

/// Share of counted vehicles that do not exist. Source: one of 254 vehicles that the program counted on eleven clips lacked
/// its vehicle when they were counted by eye. The share is (1 + 1/2) / (254 + 1), the mean with Jeffreys' prior.
const FALSE_SHARE: f64 = 0.006;

impl Vehicles {
    /// Adds a sample. `centre_m` is the distance from a car's origin forward to the centre of its body, m.
    pub(super) fn add(&mut self, sample: &TrackSample, world: Option<&World>, centre_m: f64) {
        let [from, to] = self.span_s.get_or_insert([sample.time_s; 2]);
        *from = from.min(sample.time_s);
        *to = to.max(sample.time_s);
        if let Some(moment_s) = sample.moment_s {
            self.start_local_s.get_or_insert(moment_s - sample.time_s);
        }
        self.lack_sds |= sample.own_sd_m.or(sample.sd_m).is_none();
        let class = sample.class.unwrap_or_default();
        let track = self.tracks.entry((sample.segment, sample.track)).or_insert_with(|| {
            // A table without sizes gets the means of the class.
            let [length_m, width_m] = sample.size_m.unwrap_or_else(|| {
                let dims_m = body_of(class).dims_m;
                [dims_m.x, dims_m.y]
            });
            Track {
                vehicle: Vehicle {
                    track: sample.track,
                    class,
                    length_m,
                    length_sd_m: if world.is_some() { length_share(class) * length_m } else { 0.0 },
                    width_m,
                    exists_p: if world.is_some() { 1.0 - FALSE_SHARE } else { 1.0 },
                    states: Vec::new(),
                },
                centre_m: if class == VehicleClass::Car { centre_m } else { 0.0 },
                has_motion: sample.heading_rad.is_some() && sample.speed_mps.is_some(),
                scale_at_s: f64::NEG_INFINITY,
                last: *sample,
            }
        });
        let step = track.vehicle.states.last().map_or(f64::INFINITY, |last| sample.time_s - last.time_s);
        self.is_unsorted |= sample.time_s < track.last.time_s;
        track.last = *sample;
        if step >= LEAST_STEP_S {
            track.push(sample, world);
        }
    }

    /// Returns the vehicles of each segment, sorted by track.
    pub(super) fn finish(self, worlds: &[Option<World>]) -> BTreeMap<usize, Vec<Vehicle>> {
        let mut by_segment: BTreeMap<usize, Vec<Vehicle>> = BTreeMap::new();
        for ((segment, _), mut track) in self.tracks {
            let last = track.last;
            if track.vehicle.states.last().is_some_and(|state| state.time_s < last.time_s) {
                track.push(&last, worlds.get(segment).and_then(Option::as_ref));
            }
            if !track.has_motion {
                add_motion(&mut track.vehicle.states);
            }
            track.vehicle.states.shrink_to_fit();
            by_segment.entry(segment).or_default().push(track.vehicle);
        }
        by_segment
    }
}

impl Track {
    fn push(&mut self, sample: &TrackSample, world: Option<&World>) {
        let heading = sample.heading_rad.unwrap_or(0.0);
        let (sin, cos) = heading.sin_cos();
        let [x, y] = sample.position_m;
        let speed = sample.speed_mps.unwrap_or(0.0);
        let own_sd_m = match (sample.own_sd_m, world) {
            (Some(relative), Some(world)) if self.vehicle.class == VehicleClass::Car => {
                let pose = GroundPose { x_m: x, y_m: y, heading_rad: heading };
                let body = body_variance(&pose, self.vehicle.length_m, world.height_m());
                [0, 1].map(|i| (relative[i].powi(2) + body[i]).sqrt())
            }
            _ => sample.own_sd_m.or(sample.sd_m).unwrap_or_default(),
        };
        let states = &mut self.vehicle.states;
        let scale_sd = if sample.time_s - self.scale_at_s >= SCALE_STEP_S {
            self.scale_at_s = sample.time_s;
            let pose = GroundPose { x_m: x, y_m: y, heading_rad: heading };
            world.map_or(0.0, |world| world.scale_sd(&pose)) as f32
        } else {
            states.last().map_or(0.0, |last| last.scale_sd)
        };
        let shared = speed * f64::from(scale_sd);
        let own = |sd: f64| (sd * sd - shared * shared).max(0.0).sqrt() as f32;
        let state = State {
            time_s: sample.time_s,
            x_m: x + self.centre_m * cos,
            y_m: y + self.centre_m * sin,
            heading_rad: heading as f32,
            speed_mps: speed as f32,
            own_sd_m: own_sd_m.map(|sd| sd as f32),
            own_speed_sd_mps: sample.speed_sd_mps.map_or(0.0, own),
            scale_sd,
        };
        // A parked vehicle has a row in every frame. The begin and the end of its rest say as much.
        match states.as_mut_slice() {
            [.., begin, end] if begin.rests_until(end) && end.rests_until(&state) => *end = state,
            _ => states.push(state),
        }
    }
}

/// Returns the sd of a length as a share of it. Source: the same vehicles as for [`BODY_SHARES`].
fn length_share(class: VehicleClass) -> f64 {
    if class == VehicleClass::Car { 0.05 } else { 0.18 }
}

/// Sds of the error that all positions of a car share, as shares of its length: along its heading, across it, and along
/// the line of sight. The last one also grows with the distance over the camera's height, as a shift of all keypoints in the
/// picture does. The sds of tracks lack this error, because they are those of positions relative to each other. Tracks of
/// other classes are placed by boxes, and their sds include it. Source: the passages of 235 cars over the gates of two
/// rendered streets (`scripts/traffic/check_truth.py`).
const BODY_SHARES: [f64; 3] = [0.021, 0.011, 0.0026];

/// Returns the variances of x and y from the error that all positions of a car share, m². The camera is above the origin.
fn body_variance(pose: &GroundPose, length_m: f64, camera_height_m: f64) -> [f64; 2] {
    let (sin, cos) = pose.heading_rad.sin_cos();
    let [along, across, depth] = BODY_SHARES.map(|share| share * length_m);
    // The distance cancels in the direction of the line of sight.
    let [depth_x, depth_y] = [pose.x_m, pose.y_m].map(|place| depth * place / camera_height_m);
    let sum = |parts: [f64; 3]| parts.iter().map(|part| part * part).sum();
    [sum([along * cos, across * sin, depth_x]), sum([along * sin, across * cos, depth_y])]
}

/// Computes headings and speeds from positions. A vehicle that does not move keeps its last heading.
fn add_motion(states: &mut [State]) {
    let mut heading = 0.0_f32;
    for i in 0..states.len() {
        let (a, b) = (states[i.saturating_sub(1)], states[(i + 1).min(states.len() - 1)]);
        let step = Vector2::new(b.x_m - a.x_m, b.y_m - a.y_m);
        let time_s = b.time_s - a.time_s;
        if step.norm() > 0.0 && time_s > 0.0 {
            heading = step.y.atan2(step.x) as f32;
            states[i].speed_mps = (step.norm() / time_s) as f32;
        }
        states[i].heading_rad = heading;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_cars_have_larger_errors_in_depth() {
        let at = |y_m: f64| GroundPose { x_m: 0.0, y_m, heading_rad: 0.0 };
        let [near, far] = [at(10.0), at(100.0)].map(|pose| body_variance(&pose, 5.0, 10.0).map(f64::sqrt));
        assert!((near[0] - 0.105).abs() < 1e-9 && (far[0] - 0.105).abs() < 1e-9);
        assert!(
            (near[1] - 0.055_f64.hypot(0.013)).abs() < 1e-9 && (far[1] - 0.055_f64.hypot(0.13)).abs() < 1e-9
        );
    }

    #[test]
    fn samples_in_another_order_than_that_of_time_are_noticed() {
        let is_unsorted = |times_s: [f64; 3]| {
            let mut vehicles = Vehicles::default();
            let samples = times_s.map(|time_s| TrackSample { time_s, track: 1, ..TrackSample::default() });
            samples.iter().for_each(|sample| vehicles.add(sample, None, 0.0));
            vehicles.is_unsorted
        };
        assert!(is_unsorted([0.0, 10.0, 2.0]) && !is_unsorted([0.0, 0.0, 0.1]));
    }

    #[test]
    fn an_hour_of_rest_has_two_states() {
        let mut vehicles = Vehicles::default();
        for frame in 0..36_000 {
            let moved_m = f64::from(frame - 35_990).max(0.0);
            let sample = TrackSample {
                time_s: f64::from(frame) / 10.0,
                track: 1,
                position_m: [moved_m, 20.0],
                heading_rad: Some(0.0),
                speed_mps: Some(if moved_m > 0.0 { 10.0 } else { 0.0 }),
                ..TrackSample::default()
            };
            vehicles.add(&sample, None, 0.0);
        }
        let vehicle = &vehicles.finish(&[])[&0][0];
        assert_eq!(vehicle.states.len(), 2 + 9);
        let rest_s = vehicle.states[1].time_s - vehicle.states[0].time_s;
        assert!((rest_s - 3599.0).abs() < 1e-9 && vehicle.steps().count() == 10);
        // The table has no sizes, so the size is the mean of the class.
        assert_eq!([vehicle.length_m, vehicle.width_m], [4.5, 1.8]);
    }
}
