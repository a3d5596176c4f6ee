//! Invariances: the order of the cars in a frame, the start of the clip and the choice of axes do not matter.

use nalgebra::{Matrix3, Rotation2, Vector2};
use proptest::prelude::*;
use roadplane_base::{angle_difference, wrap_angle};
use roadplane_synth::Rng;
use roadplane_track::{FrameMeasurements, Track};

use crate::{
    parked::lot,
    world::{Seeing, World, pose, straight, times, track},
};

/// Returns the frames of parked cars and a car that drives past.
fn clip(seed: u64) -> Vec<FrameMeasurements> {
    let mut cars = lot();
    cars.push(straight(pose(-9.0, 17.5, 0.0), 5.0));
    World::new(cars, Seeing { missed: 0.2, false_alarms: 0.3, ..Seeing::usual() }, times(2.0, 20.0), seed)
        .see()
        .frames
}

/// Returns the bits of all states of all tracks.
fn numbers(tracks: &[Track]) -> Vec<Vec<u64>> {
    tracks
        .iter()
        .map(|t| {
            t.states
                .iter()
                .flat_map(|s| {
                    [s.pose.x_m, s.pose.y_m, s.pose.heading_rad, s.speed_mps, s.pose_sd.x].map(f64::to_bits)
                })
                .collect()
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn the_order_of_cars_does_not_matter(seed in 0u64..1000) {
        let frames = clip(seed);
        let mut shuffled = frames.clone();
        let mut random = Rng::new(seed);
        for frame in &mut shuffled {
            for i in (1..frame.cars.len()).rev() {
                frame.cars.swap(i, (random.unit() * (i + 1) as f64) as usize);
            }
        }
        prop_assert_eq!(numbers(&track(&frames)), numbers(&track(&shuffled)));
    }

    #[test]
    fn the_start_of_the_clock_does_not_matter(seed in 0u64..1000, hours in 1i64..48) {
        let frames = clip(seed);
        let mut later = frames.clone();
        later.iter_mut().for_each(|frame| frame.stamp.pts_nanos += hours * 3_600_000_000_000);
        prop_assert_eq!(numbers(&track(&frames)), numbers(&track(&later)));
    }

    #[test]
    fn the_choice_of_axes_does_not_matter(seed in 0u64..1000, turn in -3.0f64..3.0, x in -50.0f64..50.0, y in -50.0f64..50.0) {
        let frames = clip(seed);
        let rotation = Rotation2::new(turn);
        let mut full = Matrix3::identity();
        full.fixed_view_mut::<2, 2>(0, 0).copy_from(rotation.matrix());
        let mut moved = frames.clone();
        for car in moved.iter_mut().flat_map(|frame| &mut frame.cars) {
            let place = rotation * Vector2::new(car.pose.x_m, car.pose.y_m) + Vector2::new(x, y);
            (car.pose.x_m, car.pose.y_m) = (place.x, place.y);
            car.pose.heading_rad = wrap_angle(car.pose.heading_rad + turn);
            car.covariance = full * car.covariance * full.transpose();
        }
        let (here, there) = (track(&frames), track(&moved));
        prop_assert_eq!(here.len(), there.len());
        for a in &here {
            // Tracks are compared by their detections, as their order depends on x.
            let detections = |t: &Track| t.states.iter().map(|s| (s.stamp.index, s.car)).collect::<Vec<_>>();
            let b = there.iter().find(|b| detections(b) == detections(a));
            prop_assert!(b.is_some());
            for (a, b) in a.states.iter().zip(b.into_iter().flat_map(|b| &b.states)) {
                let expected = rotation * Vector2::new(a.pose.x_m, a.pose.y_m) + Vector2::new(x, y);
                prop_assert!((expected - Vector2::new(b.pose.x_m, b.pose.y_m)).norm() < 1e-4);
                prop_assert!(angle_difference(b.pose.heading_rad, a.pose.heading_rad + turn).abs() < 1e-4);
            }
        }
    }
}
