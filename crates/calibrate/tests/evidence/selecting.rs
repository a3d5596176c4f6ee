use std::collections::BTreeMap;

use std::collections::BTreeSet;

use roadplane_calibrate::{Linker, View, ViewSelector};
use roadplane_synth::Rng;

use crate::records::{Moving, frame, rows, still};

/// Returns the views of `frames` frames at `rate` frames/s.
fn views(cars: &[Moving], frames: u64, rate: f64, mut selector: ViewSelector) -> Vec<View> {
    let mut linker = Linker::default();
    let mut random = Rng::new(1);
    for i in 0..frames {
        let record = frame(i, i as f64 / rate, cars, 2.0, 0.5, &mut random);
        let names = linker.push(&record);
        selector.push(&record, &names);
    }
    selector.take()
}

#[test]
fn a_parked_car_is_one_view_however_long() {
    for frames in [30, 3000] {
        let views = views(&rows(5), frames, 30.0, ViewSelector::default());
        assert_eq!(views.len(), 10);
        assert!(views.iter().all(|v| v.parked && (v.weight - 1.0).abs() < 1e-12));
        // The keypoints claim an sd of 2 px, all of which counts as bias.
        let sds = views[0].keypoints.iter().flatten().map(|point| point.sd_px()).collect::<Vec<_>>();
        let share = sds.iter().map(|sd| (sd / 2.0).powi(2)).sum::<f64>() / sds.len() as f64;
        assert!((1.0..1.02).contains(&share), "{share}");
    }
}

#[test]
fn a_driving_car_gives_a_view_every_half_box() {
    let car = Moving { bbox_px: [10.0, 400.0, 210.0, 520.0], velocity_px_s: [400.0, 0.0] };
    let views = views(&[car], 100, 25.0, ViewSelector::default());
    // 1600 px with a view every 100 px give more views than one car may have.
    assert_eq!(views.len(), 6);
    assert!(views.iter().all(|v| !v.parked && v.weight < 0.5));
    // Each view is one observation, with the sd of 2 px that its keypoints claim.
    assert!(views.iter().flat_map(|v| v.keypoints.iter().flatten()).all(|p| (p.sd_px() - 2.0).abs() < 1e-9));
}

#[test]
fn bounds_are_kept_and_cars_share_them() {
    let mut cars = rows(6);
    cars.extend((0..6).map(|i| Moving {
        bbox_px: [10.0, 60.0 * f64::from(i), 110.0, 60.0 * f64::from(i) + 50.0],
        velocity_px_s: [400.0, 0.0],
    }));
    let mut selector = ViewSelector::default();
    selector.max_views = 20;
    let views = views(&cars, 100, 25.0, selector);
    assert_eq!(views.len(), 20);
    let mut of_link: BTreeMap<u64, usize> = BTreeMap::new();
    views.iter().for_each(|v| *of_link.entry(v.link).or_default() += 1);
    assert!(of_link.len() >= 12, "{of_link:?}");
}

#[test]
fn small_and_empty_cars_are_no_views() {
    let mut random = Rng::new(1);
    let mut record = frame(0, 0.0, &rows(2), 1.0, 1.0, &mut random);
    record.cars[0].bbox_px = [5.0, 5.0, 25.0, 20.0];
    record.cars[1].keypoints = None;
    record.cars[2].keypoints.as_mut().unwrap().iter_mut().skip(3).for_each(|p| *p = None);
    let mut selector = ViewSelector::default();
    selector.push(&record, &[0, 1, 2, 3]);
    let views = selector.take();
    assert_eq!(views.iter().map(|v| v.link).collect::<Vec<_>>(), [3]);
    assert!(selector.take().is_empty());
}

#[test]
fn what_is_found_once_comes_after_what_is_found_again_and_only_until_there_is_enough() {
    // Twelve false objects are found once. Each case gives the cars in a row, `enough_views`, and the expected numbers
    // of views of cars and of false objects.
    for (row, enough_views, (of_cars, of_others)) in [(5, 60, (10, 10)), (10, 60, (20, 0)), (5, 12, (10, 2))]
    {
        let mut linker = Linker::default();
        let mut selector = ViewSelector::default();
        (selector.max_views, selector.enough_views) = (20, enough_views);
        let mut random = Rng::new(1);
        let mut found_once: BTreeSet<u64> = BTreeSet::new();
        for i in 0..36 {
            let mut cars = rows(row);
            let elsewhere = still(250.0 * (i / 3 % 6) as f64, 10.0 + 800.0 * (i / 18) as f64, 200.0);
            cars.extend((i % 3 == 1).then_some(elsewhere));
            let record = frame(i, i as f64, &cars, 2.0, 0.5, &mut random);
            let names = linker.push(&record);
            found_once.extend(names.iter().skip(2 * row));
            selector.push(&record, &names);
        }
        let views = selector.take();
        let again = views.iter().filter(|view| !found_once.contains(&view.link)).count();
        assert_eq!((again, views.len() - again), (of_cars, of_others), "{row} cars a row");
    }
}

#[test]
fn a_stationary_car_that_is_found_in_some_pictures_counts_once() {
    let mut random = Rng::new(1);
    let mut selector = ViewSelector::default();
    // One car is found every few seconds, with a new identifier each time.
    for i in 0..8 {
        let found = still(300.0 + 4.0 * (i % 3) as f64, 200.0, 150.0);
        selector.push(&frame(i, 4.0 * i as f64, &[found], 2.0, 0.5, &mut random), &[i]);
    }
    assert_eq!(selector.take().len(), 1);
    // Other cars drive through the same place, and each counts.
    for i in 0..12 {
        let left = [100.0, 300.0, 500.0][(i % 3) as usize];
        selector.push(
            &frame(i, 4.0 * i as f64, &[still(left, 200.0, 150.0)], 2.0, 0.5, &mut random),
            &[100 + i / 3],
        );
    }
    let views = selector.take();
    let cars: BTreeSet<u64> = views.iter().map(|view| view.link).collect();
    assert_eq!((cars.len(), views.len()), (4, 12));
}
