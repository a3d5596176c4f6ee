//! Cars that drive.

use std::f64::consts::{FRAC_PI_2, PI};

use roadplane_base::{GroundPose, angle_difference};
use roadplane_track::Track;

use crate::{
    parked::lot,
    world::{Path, Seeing, World, assert_one_track_each, pose, straight, times, track},
};

/// Returns the root mean square errors of position (m), heading (rad) and speed (m/s).
fn errors(track: &Track, world: &World, car: usize) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for state in &track.states {
        let truth = world.truth(car, &state.stamp).unwrap();
        let later = (world.cars[car])(state.stamp.time_s() + 1e-4).unwrap();
        let (sin, cos) = truth.heading_rad.sin_cos();
        let speed = ((later.x_m - truth.x_m) * cos + (later.y_m - truth.y_m) * sin) / 1e-4;
        sums[0] += (state.pose.x_m - truth.x_m).powi(2) + (state.pose.y_m - truth.y_m).powi(2);
        sums[1] += angle_difference(state.pose.heading_rad, truth.heading_rad).powi(2);
        sums[2] += (state.speed_mps - speed).powi(2);
    }
    sums.map(|sum| (sum / track.states.len() as f64).sqrt())
}

/// Returns the path of a left turn of 90°, a circle of the rear axle with straight ends.
fn turning(speed_mps: f64, radius_m: f64) -> Path {
    Box::new(move |t| {
        let driven = speed_mps * t - 8.0;
        let turned = (driven / radius_m).clamp(0.0, FRAC_PI_2);
        let beyond = (driven - radius_m * FRAC_PI_2).max(0.0);
        let rear = (
            driven.min(0.0) + radius_m * turned.sin() - 4.0,
            18.0 + radius_m * (1.0 - turned.cos()) + beyond,
        );
        Some(pose(rear.0 + 1.35 * turned.cos(), rear.1 + 1.35 * turned.sin(), turned))
    })
}

#[test]
fn a_straight_drive_without_noise_is_followed() {
    let world =
        World::new(vec![straight(pose(-8.0, 25.0, 0.1), 8.0)], Seeing::perfect(), times(2.0, 25.0), 1);
    let seen = world.see();
    let tracks = track(&seen.frames);
    assert_one_track_each(&tracks, &seen, 1);
    let [position, heading, speed] = errors(&tracks[0], &world, 0);
    assert!(position < 2e-3 && heading < 1e-3 && speed < 0.02, "{position} m, {heading} rad, {speed} m/s");
}

#[test]
fn a_turn_with_noise_is_followed() {
    for seed in 0..10 {
        let seeing = Seeing { flipped: 0.2, missed: 0.2, false_alarms: 0.0, ..Seeing::usual() };
        let world = World::new(vec![turning(6.0, 8.0)], seeing, times(4.0, 30.0), seed);
        let seen = world.see();
        let tracks = track(&seen.frames);
        assert_one_track_each(&tracks, &seen, 1);
        let [position, heading, speed] = errors(&tracks[0], &world, 0);
        assert!(position < 1.0 && heading < 0.1 && speed < 0.8, "{position} m, {heading} rad, {speed} m/s");
    }
}

#[test]
fn a_reversing_car_has_a_negative_speed() {
    let back = straight(pose(-3.0, 22.0, 0.0), -1.5);
    let world = World::new(vec![back], Seeing { false_alarms: 0.0, ..Seeing::usual() }, times(4.0, 30.0), 5);
    let seen = world.see();
    let tracks = track(&seen.frames);
    assert_one_track_each(&tracks, &seen, 1);
    let middle = &tracks[0].states[60];
    assert!((middle.speed_mps + 1.5).abs() < 0.3, "{}", middle.speed_mps);
    assert!(middle.pose.heading_rad.abs() < 0.15);
}

#[test]
fn a_fast_car_with_its_front_reversed_is_turned() {
    let seeing = Seeing { flipped: 1.0, false_alarms: 0.0, ..Seeing::usual() };
    let world = World::new(vec![straight(pose(-10.0, 28.0, 0.0), 9.0)], seeing, times(2.0, 30.0), 5);
    let seen = world.see();
    let tracks = track(&seen.frames);
    assert_one_track_each(&tracks, &seen, 1);
    assert!(tracks[0].states.iter().all(|s| s.pose.heading_rad.abs() < 0.2 && s.speed_mps > 7.0));
}

/// Returns the path of a car that starts at `start_s`, accelerates by 1.5 m/s², and is stationary again after 12 m.
fn stop_and_go(start_s: f64) -> Path {
    Box::new(move |t| {
        let t = t - start_s;
        // It accelerates for 6 m and brakes for 6 m.
        let ramp = (2.0 * 6.0 / 1.5f64).sqrt();
        let driven = if t <= 0.0 {
            0.0
        } else if t <= ramp {
            0.75 * t * t
        } else if t <= 2.0 * ramp {
            12.0 - 0.75 * (2.0 * ramp - t).powi(2)
        } else {
            12.0
        };
        Some(pose(-6.0 + driven, 20.0, 0.0))
    })
}

#[test]
fn starts_and_stops_are_found() {
    for seed in 0..10 {
        let world = World::new(
            vec![stop_and_go(3.0)],
            Seeing { false_alarms: 0.0, ..Seeing::usual() },
            times(14.0, 15.0),
            seed,
        );
        let seen = world.see();
        let tracks = track(&seen.frames);
        assert_one_track_each(&tracks, &seen, 1);
        let states = &tracks[0].states;
        let at = |time_s: f64| states.iter().find(|s| s.stamp.time_s() >= time_s).unwrap();
        assert!(at(1.0).speed_mps.abs() < 0.01 && at(12.0).speed_mps.abs() < 0.01);
        assert!((at(5.83).speed_mps - 4.24).abs() < 0.8, "{}", at(5.83).speed_mps);
        let stationary: Vec<&GroundPose> = [0.5, 1.5, 2.0].iter().map(|t| &at(*t).pose).collect();
        assert!(stationary.iter().all(|p| *p == stationary[0]), "it is stationary until it starts");
        let driven = at(13.0).pose.x_m - at(0.5).pose.x_m;
        assert!((driven - 12.0).abs() < 0.5, "{driven} m");
    }
}

#[test]
fn a_car_drives_past_a_row() {
    for seed in 0..10 {
        let mut cars = lot();
        cars.push(straight(pose(-9.0, 17.5, 0.0), 5.0));
        let seeing = Seeing { missed: 0.2, false_alarms: 0.1, flipped: 0.1, ..Seeing::usual() };
        let world = World::new(cars, seeing, times(4.0, 24.0), seed);
        let seen = world.see();
        let tracks = track(&seen.frames);
        let of = assert_one_track_each(&tracks, &seen, 10);
        let driver = &tracks[of[9]];
        assert!(
            driver.states.iter().all(|s| (s.speed_mps - 5.0).abs() < 1.2 && s.pose.heading_rad.abs() < 0.2)
        );
        for car in 0..9 {
            assert!(tracks[of[car]].states.iter().all(|s| s.speed_mps.abs() < 1e-9), "car {car} is parked");
        }
    }
}

#[test]
fn a_reversed_path_has_the_opposite_heading() {
    let world = World::new(
        vec![straight(pose(8.0, 25.0, PI), 8.0)],
        Seeing { false_alarms: 0.0, ..Seeing::usual() },
        times(2.0, 30.0),
        2,
    );
    let tracks = track(&world.see().frames);
    assert!(
        tracks[0]
            .states
            .iter()
            .all(|s| angle_difference(s.pose.heading_rad, PI).abs() < 0.2 && s.speed_mps > 6.0)
    );
}

/// A car behind others is detected in few frames. The few detections of one second show no motion.
#[test]
fn a_rarely_seen_drive_is_no_stop() {
    for seed in 0..20 {
        let seeing =
            Seeing { across_m: 0.04, along_m: 0.1, heading_sd: 0.03, false_alarms: 0.0, ..Seeing::usual() };
        let drive = straight(pose(-9.0, 26.0, -0.2), 4.4);
        let world = World::new(vec![drive], Seeing { missed: 0.0, ..seeing }, times(4.5, 4.0), seed);
        let mut seen = world.see();
        for hidden in [7, 8, 11, 12, 13, 15] {
            seen.frames[hidden].cars.clear();
            seen.owners[hidden].clear();
        }
        let tracks = track(&seen.frames);
        assert_one_track_each(&tracks, &seen, 1);
        let [position, heading, speed] = errors(&tracks[0], &world, 0);
        assert!(position < 0.3 && heading < 0.05 && speed < 0.5, "{position} m, {heading} rad, {speed} m/s");
    }
}

/// Two detections in five inference frames start a track only if a first pass had them on one.
#[test]
fn a_drive_of_an_earlier_pass_begins_with_its_first_detection() {
    let drive = straight(pose(-9.0, 26.0, 0.0), 6.0);
    let world = World::new(vec![drive], Seeing::perfect(), times(3.0, 10.0), 1);
    let begins = |known: bool| {
        let mut seen = world.see();
        for (i, frame) in seen.frames.iter_mut().enumerate() {
            frame.cars.iter_mut().for_each(|car| car.known = known);
            if [1, 2, 4, 5].contains(&i) {
                frame.cars.clear();
            }
        }
        track(&seen.frames)[0].states[0].stamp.index
    };
    assert_eq!((begins(true), begins(false)), (0, 6));
}

#[test]
fn a_car_that_waits_behind_a_mast_drives_off_as_one() {
    let mut seen = World::new(
        vec![stop_and_go(8.0)],
        Seeing { false_alarms: 0.0, ..Seeing::usual() },
        times(20.0, 10.0),
        5,
    )
    .see();
    for (i, (frame, owners)) in seen.frames.iter_mut().zip(&mut seen.owners).enumerate() {
        let waits = frame.stamp.time_s() < 8.5;
        for car in 0..frame.cars.len() {
            // The part to the right of the mast looks like a car that is stationary farther ahead.
            let mut part = frame.cars[car].clone();
            let width = part.detection.bbox_px[2] - part.detection.bbox_px[0];
            part.detection.bbox_px[0] += 0.45 * width;
            part.detection.bbox_px[2] += 0.15 * width;
            part.pose.x_m += 1.9;
            part.detection.score = 0.45;
            part.detection.car = Some(frame.cars.len());
            if waits && i % 3 > 0 {
                frame.cars.push(part);
                owners.push(Some(0));
            }
        }
    }
    let tracks = track(&seen.frames);
    assert_one_track_each(&tracks, &seen, 1);
    let last = tracks[0].states.last().unwrap();
    assert!(last.stamp.time_s() > 19.0 && (last.pose.x_m - 6.0).abs() < 0.5);
}
