//! Tests of whole scenes on vehicles with known paths.

use nalgebra::{Rotation2, Vector2};
use roadplane_base::VehicleClass;

use super::{Scene, find_scene};
use crate::{Clip, Direction, State, Vehicle};

const STEP_S: f64 = 0.2;

/// Returns a clip of 1000 s with vehicles that have the given states.
fn clip(vehicles: Vec<Vec<State>>) -> Clip {
    let vehicle = |(i, states): (usize, Vec<State>)| Vehicle {
        track: i as u64,
        class: VehicleClass::Car,
        length_m: 4.4,
        width_m: 1.8,
        length_sd_m: 0.0,
        exists_p: 1.0,
        states,
    };
    let vehicles = vehicles.into_iter().enumerate().map(vehicle).collect();
    Clip {
        name: "clip".to_owned(),
        start_s: None,
        span_s: [0.0, 1000.0],
        not_followed_s: Vec::new(),
        scale_sd: None,
        vehicles,
    }
}

/// Returns the states of a vehicle that drives through points at 10 m/s from a time on.
fn drive(points: &[[f64; 2]], start_s: f64) -> Vec<State> {
    let mut states = Vec::new();
    for pair in points.windows(2) {
        let [a, b] = [pair[0], pair[1]].map(Vector2::from);
        let steps = ((b - a).norm() / (10.0 * STEP_S)).round().max(1.0) as usize;
        for step in 0..steps {
            let at = a + (b - a) * (step as f64 / steps as f64);
            states.push(State {
                scale_sd: 0.0,
                time_s: start_s + states.len() as f64 * STEP_S,
                x_m: at.x,
                y_m: at.y,
                heading_rad: (b.y - a.y).atan2(b.x - a.x) as f32,
                speed_mps: 10.0,
                own_sd_m: [0.1, 0.1],
                own_speed_sd_mps: 0.1,
            });
        }
    }
    states
}

/// Returns an offset within ±0.2 m that differs from vehicle to vehicle.
fn aside(i: usize) -> f64 {
    [0.0, 0.15, -0.2, 0.1, -0.1, 0.2, -0.15][i % 7]
}

/// Returns vehicles on a road along y with lanes at the given x. Positive counts drive in the direction of y.
fn road(lanes: &[(f64, i32)]) -> Vec<Vec<State>> {
    let mut vehicles = Vec::new();
    for (k, &(x, count)) in lanes.iter().enumerate() {
        for i in 0..count.unsigned_abs() as usize {
            let x = x + aside(i);
            let mut points = [[x, 10.0], [x, 90.0]];
            if count < 0 {
                points.reverse();
            }
            vehicles.push(drive(&points, 10.0 + 7.0 * i as f64 + k as f64));
        }
    }
    vehicles
}

fn find(vehicles: Vec<Vec<State>>) -> Scene {
    find_scene(&[&clip(vehicles)], None)
}

fn flows(scene: &Scene) -> Vec<(usize, usize, usize)> {
    scene.flows.iter().map(|flow| (flow.from, flow.to, flow.vehicles)).collect()
}

#[test]
fn nothing_is_found_without_driving_vehicles() {
    assert_eq!(find_scene(&[], None), Scene::default());
    assert_eq!(find(Vec::new()), Scene::default());
    let parked = |k: usize| {
        let mut states = drive(&[[3.0 * k as f64, 20.0], [3.0 * k as f64, 60.0]], 5.0);
        for (i, state) in states.iter_mut().enumerate() {
            (state.y_m, state.speed_mps) = (20.0 + 4.0 * aside(i), 0.0);
        }
        states
    };
    assert_eq!(find((0..8).map(parked).collect()), Scene::default());
    let mut broken = road(&[(0.0, 5)]);
    for state in broken.iter_mut().flatten() {
        (state.x_m, state.own_sd_m) = (f64::NAN, [f32::NAN; 2]);
    }
    assert_eq!(find(broken), Scene::default());
}

#[test]
fn three_vehicles_make_a_flow_and_a_lane() {
    assert_eq!(find(road(&[(2.0, 2)])), Scene::default());
    let scene = find(road(&[(2.0, 3)]));
    assert_eq!(flows(&scene), [(1, 0, 3)]);
    let [lane] = &scene.lanes[..] else { panic!("{:?}", scene.lanes) };
    assert_eq!((lane.from, lane.to, lane.stays.len()), (Some(1), Some(0), 3));
    assert!(lane.middle.iter().all(|point| (point.x - 2.0).abs() < 0.2), "{:?}", lane.middle);
    assert!(lane.middle[lane.middle.len() - 1].y - lane.middle[0].y > 60.0);
}

#[test]
fn a_road_with_two_directions_has_two_arms() {
    let scene = find(road(&[(1.7, 9), (5.1, 9), (-1.7, -9)]));
    assert_eq!(flows(&scene), [(0, 1, 9), (1, 0, 18)]);
    let mut offsets: Vec<f64> = scene.lanes.iter().map(|lane| lane.middle[10].x).collect();
    offsets.sort_by(f64::total_cmp);
    assert_eq!(offsets.len(), 3, "{offsets:?}");
    assert!(offsets.iter().zip([-1.7, 1.7, 5.1]).all(|(a, b)| (a - b).abs() < 0.2), "{offsets:?}");
    // A vehicle that comes into the scene crosses the gate from left to right.
    let ends = &scene.arms[0].gate.line;
    assert!((ends[1] - ends[0]).perp(&scene.arms[0].outward) > 0.0, "{:?} is forward", Direction::Forward);
    assert!(scene.arms[0].outward.y > 0.99 && scene.arms[1].outward.y < -0.99);
}

#[test]
fn a_vehicle_changes_lanes_but_makes_none() {
    let mut vehicles = road(&[(1.7, 6), (5.1, 6)]);
    vehicles.push(drive(&[[1.7, 10.0], [1.7, 40.0], [5.1, 60.0], [5.1, 90.0]], 200.0));
    let scene = find(vehicles);
    assert_eq!(scene.lanes.len(), 2);
    let of_changer =
        |lane: &crate::Lane| lane.stays.iter().find(|stay| stay.track == 12).map(|stay| stay.span_s);
    let mut spans: Vec<[f64; 2]> = scene.lanes.iter().filter_map(of_changer).collect();
    spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let [first, second] = spans[..] else { panic!("{spans:?}") };
    assert!(first[1] > 202.5 && first[1] < second[0] && second[0] < 206.0, "{spans:?}");
}

#[test]
fn vehicles_that_are_lost_or_hidden_make_no_arms() {
    let mut lost = road(&[(1.7, 12), (-1.7, -12)]);
    for (i, states) in lost.iter_mut().enumerate().filter(|(i, _)| i % 4 == 0) {
        states.truncate(10 + 2 * i);
    }
    assert_eq!(find(lost).arms.len(), 2);
    // All vehicles are lost below a bridge, and found again behind it as other tracks.
    let hidden = road(&[(1.7, 12), (-1.7, -12)])
        .into_iter()
        .flat_map(|states| {
            let part =
                |keep: &dyn Fn(f64) -> bool| states.iter().filter(|state| keep(state.y_m)).copied().collect();
            [part(&|y| y < 45.0), part(&|y| y > 60.0)]
        })
        .collect();
    let scene = find(hidden);
    assert_eq!(scene.arms.len(), 2);
    assert!(scene.arms[0].gate.line[0].y > 75.0 && scene.arms[1].gate.line[0].y < 25.0);
}

/// Returns a junction of a road along y and one along x, with vehicles that turn right from one to the other.
fn junction() -> Vec<Vec<State>> {
    let mut vehicles = road(&[(1.7, 8), (-1.7, -8)]);
    for i in 0..5 {
        let (x, y, start_s) = (1.7 + aside(i), 48.3 + aside(i), 100.0 + 9.0 * i as f64);
        vehicles
            .push(drive(&[[x, 10.0], [x, y - 8.0], [x + 2.3, y - 2.3], [x + 8.0, y], [40.0, y]], start_s));
        vehicles.push(drive(&[[-40.0, y], [40.0, y]], start_s + 200.0));
    }
    vehicles
}

#[test]
fn the_arms_of_a_junction_are_named_by_the_compass() {
    let north = find_scene(&[&clip(junction())], Some(0.0));
    let names: Vec<&str> = north.arms.iter().map(|arm| arm.gate.name.as_str()).collect();
    assert_eq!(names, ["N", "E", "S", "W"]);
    assert_eq!(flows(&north), [(0, 2, 8), (2, 0, 8), (2, 1, 5), (3, 1, 5)]);
    assert_eq!(north.lanes.len(), 4);
}

#[test]
fn a_turn_of_the_world_turns_the_scene() {
    let scene = find(junction());
    for degrees in [20.0_f64, 100.0, 250.0] {
        let rotation = Rotation2::new(degrees.to_radians());
        let mut vehicles = junction();
        for state in vehicles.iter_mut().flatten() {
            let at = rotation * state.position();
            (state.x_m, state.y_m) = (at.x, at.y);
            state.heading_rad += degrees.to_radians() as f32;
        }
        let turned = find(vehicles);
        let place = |scene: &Scene| {
            let mut flows: Vec<(usize, Vector2<f64>)> =
                scene.flows.iter().map(|flow| (flow.vehicles, scene.arms[flow.from].outward)).collect();
            flows.sort_by_key(|flow| flow.0);
            flows
        };
        let counts = |scene: &Scene| place(scene).iter().map(|flow| flow.0).collect::<Vec<_>>();
        assert_eq!(counts(&turned), counts(&scene), "{degrees}");
        assert_eq!(turned.lanes.len(), scene.lanes.len());
        for lane in &scene.lanes {
            let middle = rotation * lane.middle[lane.middle.len() / 2];
            let distance = |other: &crate::Lane| {
                other.middle.iter().map(|point| (point - middle).norm()).fold(f64::INFINITY, f64::min)
            };
            assert!(turned.lanes.iter().map(distance).fold(f64::INFINITY, f64::min) < 1.0, "{degrees}");
        }
    }
}

#[test]
fn a_stop_line_is_found_where_queues_begin() {
    let stopping = |i: usize| {
        let stop_y = 45.0 + 3.0 * aside(i);
        let mut states = drive(&[[1.7, 10.0], [1.7, stop_y]], 60.0 * i as f64 + 10.0);
        let last = states[states.len() - 1];
        states.extend((1..40).map(|k| State {
            time_s: last.time_s + f64::from(k) * STEP_S,
            speed_mps: 0.0,
            ..last
        }));
        let start_s = last.time_s + 40.0 * STEP_S;
        states.extend(drive(&[[1.7, last.y_m], [1.7, 90.0]], start_s));
        let follower =
            states.iter().map(|state| State { y_m: state.y_m - 7.0, time_s: state.time_s + 0.7, ..*state });
        [follower.collect(), states]
    };
    let scene = find((0..6).flat_map(stopping).collect());
    let [line] = &scene.stop_lines[..] else { panic!("{:?}", scene.stop_lines) };
    assert_eq!((line.queues, line.lane), (6, Some(0)));
    // The last state before the stop is 2 m or less short of the place.
    assert!((line.place - Vector2::new(1.7, 45.0 + 2.2 - 2.0)).norm() < 1.5, "{:?}", line.place);
    // Its lane up to the line is a zone, in which both vehicles of a queue wait.
    let [zone] = &scene.queue_zones()[..] else { panic!("{:?}", scene.queue_zones()) };
    assert!(
        [40.0, 30.0].iter().all(|y| zone.contains(&Vector2::new(1.7, line.place.y - 45.0 + y))),
        "{zone:?}"
    );
    assert!(
        !zone.contains(&Vector2::new(1.7, line.place.y + 2.0)) && !zone.contains(&Vector2::new(4.5, 30.0))
    );
    let scattered = |i: usize| {
        let mut states = stopping(0)[1].clone();
        states.iter_mut().for_each(|state| {
            state.time_s += 60.0 * i as f64;
            state.y_m += 9.0 * i as f64;
        });
        states
    };
    assert_eq!(find((0..6).map(scattered).collect()).stop_lines, []);
}
