//! Difficult cases: crossings, duplicates, gaps, invalid input.

use nalgebra::{Matrix3, Vector3};
use roadplane_base::CarRef;
use roadplane_track::{CarMeasurement, Detection, SeenAgain, TrackOptions, Tracker};

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
            // A part of the car has a pose of its own nearby.
            double.detection.bbox_px[2] -= 0.25 * (double.detection.bbox_px[2] - double.detection.bbox_px[0]);
            double.pose.x_m += 0.5;
            double.pose.y_m -= 0.6;
            double.detection.score = 0.5;
            double.detection.car = Some(frame.cars.len());
            frame.cars.push(double);
            owners.push(Some(0));
        }
    }
    let tracks = track(&seen.frames);
    assert_eq!(tracks.len(), 9);
}

#[test]
fn a_second_box_whose_place_scatters_makes_no_second_track() {
    let mut seen = World::new(
        vec![straight(pose(-9.0, 22.0, 0.0), 4.0)],
        Seeing { false_alarms: 0.0, ..Seeing::usual() },
        times(4.0, 10.0),
        3,
    )
    .see();
    for (i, (frame, owners)) in seen.frames.iter_mut().zip(&mut seen.owners).enumerate() {
        for car in 0..frame.cars.len() {
            let mut double = frame.cars[car].clone();
            let [x0, _, x1, _] = double.detection.bbox_px;
            double.detection.bbox_px[0] += 0.4 * (x1 - x0);
            double.detection.bbox_px[2] += 0.4 * (x1 - x0);
            // The position differs in every frame. On average it is that of the car.
            double.pose.y_m += if i % 2 == 0 { 1.8 } else { -1.8 };
            double.covariance *= 4.0;
            double.detection.score = 0.4;
            double.detection.car = Some(frame.cars.len());
            frame.cars.push(double);
            owners.push(Some(0));
        }
    }
    assert_eq!(track(&seen.frames).len(), 1);
}

#[test]
fn a_car_that_is_seen_again_takes_no_other_box() {
    // In a queue, the car behind appears after a while, half hidden. It is measured in the frames in which the car in
    // front is only detected again.
    let cars = vec![straight(pose(0.0, 40.0, -1.57), 5.0), straight(pose(0.6, 43.5, -1.57), 5.0)];
    let mut seen = World::new(cars, Seeing { missed: 0.0, ..Seeing::perfect() }, times(3.0, 30.0), 5).see();
    let mut source = None;
    for (i, (frame, owners)) in seen.frames.iter_mut().zip(&seen.owners).enumerate() {
        let measured = usize::from(i % 3 != 0);
        let index = |owner: usize| owners.iter().position(|o| *o == Some(owner));
        match (index(0), source) {
            (Some(front), _) if measured == 0 => {
                let car = frame.cars[front].detection.car.unwrap();
                source = Some(CarRef { frame: frame.stamp.index, car });
            }
            (Some(front), Some(source)) => {
                let Detection { bbox_px, score, .. } = frame.cars[front].detection;
                frame.seen_again.push(SeenAgain { source, bbox_px, score });
            }
            _ => {}
        }
        let kept: Vec<bool> = owners.iter().map(|owner| *owner == Some(measured)).collect();
        let mut keep = kept.iter();
        frame.cars.retain(|_| *keep.next().unwrap() && (measured == 0 || frame.stamp.time_s() > 1.0));
        for car in frame.cars.iter_mut().filter(|_| measured == 1) {
            car.covariance = Matrix3::from_diagonal(&Vector3::new(0.5, 1.5, 0.01));
        }
    }
    let tracks = track(&seen.frames);
    let of = assert_one_track_each(&tracks, &seen, 2);
    for state in &tracks[of[0]].states {
        let truth = 40.0 - 5.0 * state.stamp.time_s();
        assert!((state.pose.y_m - truth).abs() < 0.5, "{} for {truth}", state.pose.y_m);
        // Also in the frames in which it is only detected again, the car counts as detected, with its box.
        assert!(state.bbox_px.is_some() && state.score > 0.0);
    }
}

#[test]
fn detections_without_keypoints_count_for_a_brief_vehicle() {
    // A car crosses the picture. It is measured in every second frame, and only detected in the others.
    for (detections, tracks) in [(6, 1), (5, 0)] {
        let path = straight(pose(-3.0, 25.0, 0.0), 6.0);
        let end_s = (detections as f64 - 0.5) / 10.0;
        let cars: Vec<Path> = vec![Box::new(move |t| if t < end_s { path(t) } else { None })];
        let mut seen = World::new(cars, Seeing::perfect(), times(3.0, 10.0), 5).see();
        for i in (1..detections).step_by(2) {
            let source = CarRef { frame: i as u64 - 1, car: 0 };
            let Detection { bbox_px, score, .. } = seen.frames[i].cars.remove(0).detection;
            seen.frames[i].seen_again.push(SeenAgain { source, bbox_px, score });
        }
        assert_eq!(track(&seen.frames).len(), tracks, "{detections} detections");
    }
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
    // Half a second is damaged: it has no frames at all.
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
fn a_stationary_car_did_not_drive_there_undetected_from_another_bay() {
    let between = |from_s: f64, to_s: f64, path: Path| -> Path {
        Box::new(move |time_s| path(time_s).filter(|_| (from_s..to_s).contains(&time_s)))
    };
    for seed in 0..10 {
        let cars =
            vec![between(0.0, 1.5, parked(-4.0, 26.0, -0.4)), between(5.2, 9.0, parked(5.7, 28.1, 2.8))];
        let seen = World::new(cars, Seeing::perfect(), times(9.0, 10.0), seed).see();
        assert_one_track_each(&track(&seen.frames), &seen, 2);
    }
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
            2 => car.detection.bbox_px = [5.0, 5.0, 5.0, 9.0],
            _ => car.shape.information[(0, 0)] = f64::INFINITY,
        }
        tracker.push(&frame);
    }
    assert_eq!(tracker.rejected, 30);
    assert_eq!(tracker.finish(&()).tracks.len(), 8);
    assert!(Tracker::new(TrackOptions::default()).finish(&()).tracks.is_empty());
}

#[test]
fn a_vehicle_whose_place_is_vague_takes_nobody_elses_track() {
    // A car drives off and is gone. A truck appears elsewhere, of which there is only a box.
    let cars = vec![
        straight(pose(-6.0, 22.0, 0.3), 6.0),
        Box::new(|t: f64| (t > 1.6).then(|| pose(-8.0, 30.0 - 1.5 * t, -1.2))) as Path,
    ];
    let mut seen = World::new(cars, Seeing { missed: 0.0, ..Seeing::usual() }, times(5.0, 10.0), 2).see();
    for (frame, owners) in seen.frames.iter_mut().zip(&seen.owners) {
        let gone = frame.stamp.time_s() > 1.5;
        for (car, owner) in frame.cars.iter_mut().zip(owners.iter()) {
            if *owner == Some(1) {
                car.detection.class = roadplane_base::VehicleClass::Truck;
                car.from_box = true;
                car.covariance = Matrix3::from_diagonal(&nalgebra::Vector3::new(16.0, 64.0, 0.3));
            }
        }
        let first = owners.iter().position(|owner| *owner == Some(0));
        frame.cars.retain(|car| !(gone && first == car.detection.car));
    }
    let tracks = track(&seen.frames);
    assert_eq!(tracks.len(), 2, "{:?}", owners(&tracks, &seen));
}

#[test]
fn parts_of_one_car_are_one_and_cars_in_a_row_are_two() {
    let seeing = Seeing { missed: 0.0, false_alarms: 0.0, ..Seeing::usual() };
    let drive = |ahead_m: f64| straight(pose(-8.0 + ahead_m, 26.0, 0.0), 3.0);
    // An object comes between. From 2.4 s on the front half is found, and up to 2.6 s the rear half.
    let world = World::new(vec![drive(0.0)], seeing.clone(), times(5.0, 10.0), 8);
    let mut frames = world.see().frames;
    for (i, frame) in frames.iter_mut().enumerate() {
        let whole = frame.cars[0].clone();
        let [x0, y0, x1, y1] = whole.detection.bbox_px;
        let middle = (x0 + x1) / 2.0;
        let part = |bbox_px, car| CarMeasurement {
            detection: Detection { bbox_px, car: Some(car), ..whole.detection },
            ..whole.clone()
        };
        let rear = part([x0, y0, middle + 3.0, y1], 0);
        let front = part([middle - 3.0, y0, x1, y1], 1);
        frame.cars = match i {
            0..24 => vec![rear],
            24..26 => vec![rear, front],
            _ => vec![front],
        };
    }
    let tracks = track(&frames);
    assert_eq!(tracks.iter().map(|track| track.states.len()).collect::<Vec<_>>(), [50]);
    // One car leaves as the other comes, a car's length and a gap behind.
    let world = World::new(vec![drive(0.0), drive(-6.0)], seeing, times(5.0, 10.0), 8);
    let mut frames = world.see().frames;
    for (i, frame) in frames.iter_mut().enumerate() {
        frame.cars.retain(|car| {
            if i < 24 { car.detection.car == Some(0) } else { i < 26 || car.detection.car == Some(1) }
        });
    }
    assert_eq!(track(&frames).len(), 2);
}

#[test]
fn of_two_cars_after_a_gap_the_one_with_the_old_colour_continues_the_track() {
    let drive = |ahead_m: f64, from_s: f64, to_s: f64| {
        let place = move |t: f64| pose(ahead_m + 5.0 * t - 12.0, 26.0, 0.0);
        Box::new(move |t: f64| (from_s..to_s).contains(&t).then(|| place(t))) as Path
    };
    let lanes = || vec![drive(0.0, 0.0, 1.5), drive(2.7, 2.5, 5.0), drive(-2.7, 2.5, 5.0)];
    let seeing = Seeing { missed: 0.0, false_alarms: 0.0, ..Seeing::usual() };
    let (red, grey) = ([150, 20, 20], [90; 3]);
    for (same, colours) in [(1, [red, red, grey]), (2, [red, grey, red])] {
        let mut continued = [0; 3];
        for seed in 0..10 {
            let mut seen = World::new(lanes(), seeing.clone(), times(4.0, 10.0), seed).see();
            for (frame, owners) in seen.frames.iter_mut().zip(&seen.owners) {
                for (car, owner) in frame.cars.iter_mut().zip(owners) {
                    car.detection.colour_rgb = owner.map(|owner| colours[owner]);
                }
            }
            let tracks = track(&seen.frames);
            let first = tracks.iter().find(|track| track.states[0].stamp.index == 0).unwrap();
            let last = first.states.last().unwrap();
            continued[seen.owners[last.stamp.index as usize][last.car.unwrap()].unwrap()] += 1;
        }
        assert!(continued[same] >= 7 && continued[3 - same] == 0, "{continued:?}");
    }
}
