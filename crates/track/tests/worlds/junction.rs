//! A busy junction: lanes with a queue at a light, crossing traffic that hides it, and a bay that another car takes.

use std::collections::BTreeMap;

use roadplane_base::{GroundPose, VehicleClass, assign};
use roadplane_synth::Rng;
use roadplane_track::Track;

use crate::world::{Path, Seeing, Seen, World, pose, times, track};

/// Length of the clip, s.
const SECONDS: f64 = 75.0;
/// Time step of the simulation, s.
const STEP_S: f64 = 0.05;
/// Position x of the lanes towards the camera, m.
const LANES: [f64; 3] = [-1.0, 2.5, 6.0];
/// Position y of the line at which the light stops cars, m.
const LINE_M: f64 = 24.0;
/// Begin and end of the red phases, s.
const RED_S: [[f64; 2]; 2] = [[8.0, 28.0], [45.0, 62.0]];

/// Simulates the cars of a lane by the intelligent driver model (Treiber, Hennecke and Helbing 2000).
fn lane(x_m: f64, cars: usize, random: &mut Rng) -> Vec<Path> {
    let steps = (SECONDS / STEP_S) as usize;
    let enters: Vec<f64> = (0..cars).map(|i| 5.0 * i as f64 + 2.0 * random.unit()).collect();
    let wish: Vec<f64> = (0..cars).map(|_| 9.0 + 3.0 * random.unit()).collect();
    let mut paths: Vec<Vec<Option<f64>>> = vec![Vec::with_capacity(steps); cars];
    let mut state: Vec<Option<(f64, f64)>> = vec![None; cars];
    for step in 0..steps {
        let time_s = step as f64 * STEP_S;
        let red = RED_S.iter().any(|[from, to]| (*from..*to).contains(&time_s));
        for i in 0..cars {
            let before = i.checked_sub(1).and_then(|i| state[i]);
            if state[i].is_none() && time_s >= enters[i] && before.is_none_or(|(y, _)| y < 65.0) {
                state[i] = Some((75.0, wish[i]));
            }
            if let Some((y, v)) = state[i] {
                let mut braking = 0.0_f64;
                let mut obstacle = |gap_m: f64, closing: f64| {
                    let wanted = 2.0 + v * 1.2 + v * closing / (2.0 * (1.5_f64 * 2.5).sqrt());
                    braking = braking.max((wanted.max(2.0) / gap_m.max(0.3)).powi(2));
                };
                if let Some((ahead, speed)) = before {
                    obstacle(y - ahead - 5.0, v - speed);
                }
                if red && y > LINE_M {
                    obstacle(y - LINE_M, v);
                }
                let acceleration = (1.5 * (1.0 - (v / wish[i]).powi(4) - braking)).max(-7.0);
                let speed = (v + acceleration * STEP_S).max(0.0);
                state[i] = Some((y - speed * STEP_S, speed));
            }
            paths[i].push(state[i].map(|(y, _)| y).filter(|y| (5.0..75.0).contains(y)));
        }
    }
    let down = -std::f64::consts::FRAC_PI_2;
    paths
        .into_iter()
        .map(|ys| -> Path {
            Box::new(move |t| {
                let y = ys.get((t / STEP_S).round() as usize).copied().flatten()?;
                Some(pose(x_m, y, down))
            })
        })
        .collect()
}

/// Returns the junction's world, of which a detector with this quality sees the cars.
fn junction(seeing: Seeing, seed: u64) -> World {
    let mut random = Rng::new(seed);
    let mut cars: Vec<Path> = LANES.iter().flat_map(|x| lane(*x, 9, &mut random)).collect();
    // While the light is red, crossing traffic passes in front of the queue.
    for [from, to] in RED_S {
        let mut at = from + 3.0;
        while at + 6.0 < to {
            let (start, speed) = (at, 7.0 + 3.0 * random.unit());
            cars.push(Box::new(move |t| {
                let x = -22.0 + speed * (t - start);
                (t >= start && x < 22.0).then(|| pose(x, 19.0, 0.0))
            }));
            at += 3.5 + 2.0 * random.unit();
        }
    }
    // In a bay, one car leaves backwards and drives off. Another car takes the bay half a minute later.
    let bay = (-9.0, 33.0);
    cars.push(Box::new(move |t| {
        let out = (1.5 * (t - 20.0)).clamp(0.0, 6.0);
        let away = (5.0 * (t - 26.0)).max(0.0);
        (away < 60.0).then(|| pose(bay.0 + out, bay.1 - away, 0.0))
    }));
    cars.push(Box::new(move |t| {
        let there = (4.0 * (t - 52.0)).clamp(0.0, 16.0);
        (t >= 52.0).then(|| pose(bay.0 + 16.0 - there, bay.1, std::f64::consts::PI))
    }));
    World::new(cars, seeing, times(SECONDS, 10.0), seed)
}

/// Returns IDF1 (Ristani et al. 2016) and the identity switches per vehicle, from the vehicle of each detection.
fn identities(tracks: &[Track], seen: &Seen) -> (f64, f64) {
    let mut together: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    let mut last: BTreeMap<usize, (u64, usize)> = BTreeMap::new();
    let mut history: Vec<(u64, usize, usize)> = Vec::new();
    let mut found = 0.0;
    for (index, track) in tracks.iter().enumerate() {
        for state in track.states.iter().filter(|state| state.bbox_px.is_some()) {
            found += 1.0;
            let Some(car) = state.car else { continue };
            if let Some(owner) = seen.owners[state.stamp.index as usize][car] {
                *together.entry((index, owner)).or_default() += 1.0;
                history.push((state.stamp.index, owner, index));
            }
        }
    }
    history.sort_unstable();
    let mut switches = 0.0;
    for (frame, owner, index) in history {
        if last.insert(owner, (frame, index)).is_some_and(|(_, before)| before != index) {
            switches += 1.0;
        }
    }
    let owners: Vec<usize> = seen.owners.iter().flatten().flatten().copied().collect();
    let vehicles = owners.iter().max().map_or(0, |most| most + 1);
    let count = |i: usize, j: usize| together.get(&(i, j)).copied().unwrap_or(0.0);
    let pairs = assign(tracks.len(), vehicles, 0.0, |i, j| -count(i, j));
    let hits: f64 = pairs.iter().enumerate().filter_map(|(i, j)| j.map(|j| count(i, j))).sum();
    (2.0 * hits / (found + owners.len() as f64), switches / vehicles as f64)
}

/// Returns a quality of detections with more misses and false alarms than usual.
fn hard() -> Seeing {
    Seeing { missed: 0.1, false_alarms: 0.05, flipped: 0.03, ..Seeing::usual() }
}

#[test]
fn vehicles_of_a_busy_junction_keep_their_names() {
    let (mut worst, mut sum, mut changes) = (1.0_f64, 0.0, 0.0);
    for seed in 0..3 {
        let seen = junction(hard(), seed).see();
        let (idf1, switches) = identities(&track(&seen.frames), &seen);
        println!("seed {seed}: IDF1 {idf1:.4}, switches a vehicle {switches:.3}");
        (worst, sum, changes) = (worst.min(idf1), sum + idf1 / 3.0, changes + switches / 3.0);
    }
    assert!(sum >= 0.97 && worst >= 0.95, "IDF1 {sum}, worst {worst}");
    assert!(changes <= 0.05, "{changes} switches a vehicle");
}

#[test]
fn labels_that_flip_cost_no_identity() {
    let mut seen = junction(hard(), 7).see();
    let before = identities(&track(&seen.frames), &seen);
    let mut random = Rng::new(1);
    for car in seen.frames.iter_mut().flat_map(|frame| &mut frame.cars) {
        if random.unit() < 0.2 {
            // A box that is classed as a truck has no keypoints. It gives the position to a metre.
            car.detection.class = VehicleClass::Truck;
            car.from_box = true;
            car.covariance += nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(0.8, 0.8, 0.8));
        }
    }
    let tracks = track(&seen.frames);
    let after = identities(&tracks, &seen);
    println!("{before:?} → {after:?}");
    assert!(after.0 >= before.0 - 0.02 && after.1 <= before.1 + 0.05, "{before:?} → {after:?}");
    assert!(tracks.iter().all(|track| track.class == VehicleClass::Car));
}

#[test]
fn nothing_moves_as_no_vehicle_can() {
    let seen = junction(hard(), 3).see();
    for track in track(&seen.frames) {
        for pair in track.states.windows(2) {
            let dt = pair[1].stamp.time_s() - pair[0].stamp.time_s();
            let moved_m = (pair[1].pose.x_m - pair[0].pose.x_m).hypot(pair[1].pose.y_m - pair[0].pose.y_m);
            assert!(moved_m <= 25.0 * dt + 0.3, "track {} moves {moved_m} m in {dt} s", track.id);
            let (a, b): (&GroundPose, &GroundPose) = (&pair[0].pose, &pair[1].pose);
            let back = (b.x_m - a.x_m) * a.heading_rad.cos() + (b.y_m - a.y_m) * a.heading_rad.sin();
            assert!(back >= -4.0 * dt - 0.2, "track {} goes {back} m backwards in {dt} s", track.id);
        }
    }
}
