//! Rows of parked cars.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Vector3};
use roadplane_base::{VehicleClass, angle_difference};

use crate::world::{Path, Seeing, World, assert_one_track_each, parked, times, track};

/// Returns two rows of cars in marked bays, nose to nose, as in a car park.
pub fn lot() -> Vec<Path> {
    let back = (0..5).map(|i| parked(-6.0 + 2.8 * f64::from(i), 30.0, -FRAC_PI_2));
    let front = (0..4).map(|i| parked(-5.0 + 2.8 * f64::from(i), 22.0, FRAC_PI_2));
    back.chain(front).collect()
}

#[test]
fn without_noise_the_truth_comes_out() {
    let world = World::new(lot(), Seeing::perfect(), times(1.0, 30.0), 1);
    let seen = world.see();
    let tracks = track(&seen.frames);
    for (car, index) in assert_one_track_each(&tracks, &seen, 9).into_iter().enumerate() {
        let states = &tracks[index].states;
        assert_eq!(states.len(), 30);
        for state in states {
            let truth = world.truth(car, &state.stamp).unwrap();
            assert!((state.pose.x_m - truth.x_m).abs() < 1e-9 && (state.pose.y_m - truth.y_m).abs() < 1e-9);
            assert!(angle_difference(state.pose.heading_rad, truth.heading_rad).abs() < 1e-9);
            assert!(state.speed_mps.abs() < 1e-9 && state.bbox_px.is_some());
        }
    }
}

#[test]
fn noisy_parked_cars_stay_put() {
    for seed in 0..20 {
        let seeing = Seeing { flipped: 0.2, missed: 0.2, false_alarms: 0.3, ..Seeing::usual() };
        let world = World::new(lot(), seeing, times(50.0 / 30.0, 30.0), seed);
        let seen = world.see();
        let tracks = track(&seen.frames);
        for (car, index) in assert_one_track_each(&tracks, &seen, 9).into_iter().enumerate() {
            let states = &tracks[index].states;
            let first = states[0].pose;
            let truth = world.truth(car, &states[0].stamp).unwrap();
            for state in states {
                assert_eq!(state.pose, first, "a parked car has one pose");
                assert!(state.speed_mps.abs() < 1e-9);
            }
            let away = (first.x_m - truth.x_m).hypot(first.y_m - truth.y_m);
            assert!(away < 4.0 * states[0].pose_sd.xy().norm(), "seed {seed}, car {car}: {away} m");
            let turned = angle_difference(first.heading_rad, truth.heading_rad).abs();
            assert!(turned < 0.3, "seed {seed}, car {car} of {} states: {turned} rad off", states.len());
        }
    }
}

#[test]
fn a_parked_car_hidden_for_long_is_the_same_car() {
    let mut cars = lot();
    cars.truncate(3);
    let world = World::new(cars, Seeing { false_alarms: 0.0, ..Seeing::usual() }, times(30.0, 10.0), 3);
    let mut seen = world.see();
    // An object is in front of car 1 for 20 s.
    for (frame, owners) in seen.frames.iter_mut().zip(&mut seen.owners).skip(50).take(200) {
        frame.cars.retain(|car| owners[car.detection.car.unwrap()] != Some(1));
        owners.retain(|owner| *owner != Some(1));
        frame.cars.iter_mut().enumerate().for_each(|(i, car)| car.detection.car = Some(i));
    }
    let tracks = track(&seen.frames);
    let index = assert_one_track_each(&tracks, &seen, 3)[1];
    let states = &tracks[index].states;
    assert!(states.len() > 290, "filled in while hidden");
    assert_eq!(
        states.iter().filter(|s| s.stamp.index >= 50 && s.stamp.index < 250 && s.bbox_px.is_none()).count(),
        200
    );
}

#[test]
fn a_single_picture_gives_tracks_of_one_state() {
    let world = World::new(lot(), Seeing::perfect(), vec![0.0], 1);
    let seen = world.see();
    let tracks = track(&seen.frames);
    assert_eq!(tracks.len(), 9);
    assert!(tracks.iter().all(|t| t.states.len() == 1 && t.states[0].bbox_px.is_some()));
    let order: Vec<f64> = tracks.iter().map(|t| t.states[0].pose.x_m).collect();
    assert!(order.is_sorted() && tracks.iter().map(|t| t.id).eq(1..=9));
}

#[test]
fn a_car_that_is_hidden_half_by_half_is_one_car() {
    let cars = vec![parked(2.0, 24.0, 0.4)];
    let mut seen = World::new(cars, Seeing { missed: 0.0, ..Seeing::usual() }, times(12.0, 10.0), 4).see();
    // An object passes in front of the car. It hides the left part, then the whole car, then the right part.
    for frame in &mut seen.frames {
        let time_s = frame.stamp.time_s();
        frame.cars.retain(|_| !(5.0..7.0).contains(&time_s));
        for car in &mut frame.cars {
            let [x0, _, x1, _] = car.detection.bbox_px;
            let middle = (x0 + x1) / 2.0;
            if (4.0..5.0).contains(&time_s) {
                car.detection.bbox_px[0] = middle;
                car.detection.hidden[0] = true;
            } else if (7.0..8.0).contains(&time_s) {
                car.detection.bbox_px[2] = middle;
                car.detection.hidden[2] = true;
            }
        }
    }
    let tracks = track(&seen.frames);
    assert_eq!(tracks.len(), 1);
    assert_eq!(tracks[0].states.last().map(|state| state.stamp.index), Some(119));
}

#[test]
fn a_box_that_appears_where_a_lorry_was_is_not_the_lorry() {
    let mut seen = World::new(vec![parked(2.0, 24.0, 0.4)], Seeing::perfect(), times(12.0, 10.0), 4).see();
    // The lorry leaves at 5 s. A second later a car behind it is found, whose left part a third vehicle hides. It lies
    // within the uncertainty of the lorry's position.
    for frame in &mut seen.frames {
        let time_s = frame.stamp.time_s();
        frame.cars.retain(|_| !(5.0..6.0).contains(&time_s));
        for car in &mut frame.cars {
            let [x0, y0, x1, y1] = car.detection.bbox_px;
            car.covariance = Matrix3::from_diagonal(&Vector3::new(3.0, 3.0, 0.1));
            (car.from_box, car.detection.class) = (true, VehicleClass::Truck);
            if time_s >= 6.0 {
                car.detection.bbox_px =
                    [x0 + 0.6 * (x1 - x0), y0 + 0.4 * (y1 - y0), x0 + 0.8 * (x1 - x0), y0 + 0.8 * (y1 - y0)];
                car.detection.hidden[0] = true;
            }
        }
    }
    let tracks = track(&seen.frames);
    let ends: Vec<u64> = tracks.iter().filter_map(|track| Some(track.states.last()?.stamp.index)).collect();
    assert_eq!(ends, [49, 119]);
}
