use std::collections::BTreeSet;

use proptest::prelude::*;
use roadplane_calibrate::Linker;
use roadplane_synth::Rng;

use crate::records::{Moving, frame, rows, still};

#[test]
fn cars_keep_their_names_while_one_drives_past() {
    let mut cars = rows(5);
    cars.push(Moving { bbox_px: [0.0, 450.0, 160.0, 560.0], velocity_px_s: [300.0, 0.0] });
    let mut linker = Linker::default();
    let mut random = Rng::new(1);
    let mut first = None;
    for i in 0..100 {
        let mut record = frame(i, i as f64 / 25.0, &cars, 2.0, 1.0, &mut random);
        // One detection in five is missing.
        let kept: Vec<bool> = record.cars.iter().map(|_| i == 0 || random.unit() > 0.2).collect();
        let mut keep = kept.iter();
        record.cars.retain(|_| *keep.next().unwrap());
        let names = linker.push(&record);
        let first = first.get_or_insert_with(|| names.clone());
        let expected: Vec<u64> =
            first.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(n, _)| *n).collect();
        assert_eq!(names, expected, "frame {i}");
    }
}

#[test]
fn a_parked_car_is_recognised_after_20_s_and_a_driving_one_is_not() {
    let mut linker = Linker::default();
    let mut random = Rng::new(2);
    let cars = [
        still(500.0, 500.0, 150.0),
        Moving { bbox_px: [100.0, 100.0, 250.0, 200.0], velocity_px_s: [60.0, 0.0] },
    ];
    let mut names = Vec::new();
    for i in 0..50 {
        names = linker.push(&frame(i, i as f64 / 25.0, &cars, 1.0, 1.0, &mut random));
    }
    let later = linker.push(&frame(550, 22.0, &cars, 1.0, 1.0, &mut random));
    assert_eq!(later[0], names[0]);
    assert_ne!(later[1], names[1]);
    linker.reset();
    let after = linker.push(&frame(551, 22.04, &cars, 1.0, 1.0, &mut random));
    let all: BTreeSet<u64> = names.iter().chain(&later).chain(&after).copied().collect();
    assert_eq!(all.len(), 5, "names are never used twice");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(50))]

    #[test]
    fn the_order_of_cars_does_not_matter(seed in 0u64..10_000) {
        let mut random = Rng::new(seed);
        let (mut one, mut two) = (Linker::default(), Linker::default());
        for i in 0..10 {
            let record = frame(i, i as f64 / 10.0, &rows(3), 20.0, 1.0, &mut random);
            let mut reversed = record.clone();
            reversed.cars.reverse();
            let mut names = two.push(&reversed);
            names.reverse();
            prop_assert_eq!(one.push(&record), names);
        }
    }
}
