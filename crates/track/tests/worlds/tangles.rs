//! What can go wrong: crossings, duplicates, gaps, nonsense.

use nalgebra::Matrix3;
use roadplane_track::{TrackOptions, Tracker};

use crate::{
    parked::lot,
    world::{Path, Seeing, World, assert_one_track_each, owners, parked, pose, straight, times, track},
};

#[test]
fn crossing_cars_keep_their_names() {
    for seed in 0..10 {
        let cars = vec![straight(pose(-9.0, 20.0, 0.0), 6.0), straight(pose(9.0, 25.0, 3.1), 6.0)];
        let seeing = Seeing { missed: 0.1, false_alarms: 0.0, ..Seeing::usual() };
        let world = World::new(cars, seeing, times(3.0, 25.0), seed);
        let seen = world.see();
        assert_one_track_each(&track(&seen.frames), &seen, 2);
    }
}

#[test]
fn a_second_box_on_a_car_makes_no_second_track() {
    let world = World::new(lot(), Seeing { false_alarms: 0.0, ..Seeing::usual() }, times(3.0, 30.0), 7);
    let mut seen = world.see();
    for (frame, owners) in seen.frames.iter_mut().zip(&mut seen.owners) {
        let doubles: Vec<_> = (0..frame.cars.len()).filter(|&i| owners[i] == Some(0)).collect();
        for i in doubles {
            let mut double = frame.cars[i].clone();
            // A part of the car, with a pose of its own nearby.
            double.bbox_px[2] -= 0.25 * (double.bbox_px[2] - double.bbox_px[0]);
            double.pose.x_m += 0.5;
            double.pose.y_m -= 0.6;
            double.score = 0.5;
            double.car = frame.cars.len();
            frame.cars.push(double);
            owners.push(Some(0));
        }
    }
    let tracks = track(&seen.frames);
    assert_eq!(tracks.len(), 9);
}

#[test]
fn flickering_false_alarms_make_no_track() {
    let seeing = Seeing { false_alarms: 1.0, ..Seeing::usual() };
    for seed in 0..10 {
        let world = World::new(vec![parked(0.0, 20.0, 0.3)], seeing.clone(), times(10.0, 10.0), seed);
        let seen = world.see();
        assert_one_track_each(&track(&seen.frames), &seen, 1);
    }
}

#[test]
fn a_hole_in_time_is_bridged() {
    // Half a second is damaged: no frames at all.
    let all = times(4.0, 25.0);
    let kept: Vec<f64> = all.into_iter().filter(|t| !(1.5..2.0).contains(t)).collect();
    let cars = vec![straight(pose(-9.0, 22.0, 0.0), 5.0), parked(2.0, 28.0, 1.5)];
    let world = World::new(cars, Seeing { false_alarms: 0.0, ..Seeing::usual() }, kept, 4);
    let seen = world.see();
    let tracks = track(&seen.frames);
    let of = assert_one_track_each(&tracks, &seen, 2);
    assert!(tracks[of[0]].states.iter().all(|s| (s.speed_mps - 5.0).abs() < 1.5));
}

#[test]
fn any_frame_rate_will_do() {
    for (rate, seconds) in [(2.0, 8.0), (5.0, 8.0), (12.5, 4.0), (60.0, 3.0)] {
        let cars = vec![straight(pose(-8.0, 24.0, 0.0), 2.0), parked(2.0, 30.0, 1.5), parked(4.8, 30.0, 1.5)];
        let seeing = Seeing { false_alarms: 0.0, missed: 0.0, ..Seeing::usual() };
        let world = World::new(cars, seeing, times(seconds, rate), 6);
        let seen = world.see();
        let tracks = track(&seen.frames);
        let of = assert_one_track_each(&tracks, &seen, 3);
        let middle = &tracks[of[0]].states[tracks[of[0]].states.len() / 2];
        assert!((middle.speed_mps - 2.0).abs() < 0.5, "{rate} frames/s: {} m/s", middle.speed_mps);
    }
}

#[test]
fn nonsense_is_counted_and_left_out() {
    let world = World::new(lot(), Seeing::perfect(), times(1.0, 30.0), 1);
    let mut tracker = Tracker::new(TrackOptions::default());
    for (i, mut frame) in world.see().frames.into_iter().enumerate() {
        let car = &mut frame.cars[0];
        match i % 4 {
            0 => car.pose.x_m = f64::NAN,
            1 => car.covariance = Matrix3::zeros(),
            2 => car.bbox_px = [5.0, 5.0, 5.0, 9.0],
            _ => car.shape_information[(0, 0)] = f64::INFINITY,
        }
        tracker.push(&frame);
    }
    assert_eq!(tracker.rejected(), 30);
    assert_eq!(tracker.finish().len(), 8);
    assert!(Tracker::new(TrackOptions::default()).finish().is_empty());
}

#[test]
fn a_vehicle_whose_place_is_vague_takes_nobody_elses_track() {
    // A car drives off and is gone; a truck appears elsewhere of which only the box is known.
    let cars = vec![
        straight(pose(-6.0, 22.0, 0.3), 6.0),
        Box::new(|t: f64| (t > 1.6).then(|| pose(-8.0, 30.0 - 1.5 * t, -1.2))) as Path,
    ];
    let mut seen = World::new(cars, Seeing { missed: 0.0, ..Seeing::usual() }, times(5.0, 10.0), 2).see();
    for (frame, owners) in seen.frames.iter_mut().zip(&seen.owners) {
        let gone = frame.stamp.time_s() > 1.5;
        for (car, owner) in frame.cars.iter_mut().zip(owners.iter()) {
            if *owner == Some(1) {
                car.class = roadplane_base::VehicleClass::Truck;
                car.from_box = true;
                car.covariance = Matrix3::from_diagonal(&nalgebra::Vector3::new(16.0, 64.0, 0.3));
            }
        }
        let first = owners.iter().position(|owner| *owner == Some(0));
        frame.cars.retain(|car| !(gone && first == Some(car.car)));
    }
    let tracks = track(&seen.frames);
    assert_eq!(tracks.len(), 2, "{:?}", owners(&tracks, &seen));
}
