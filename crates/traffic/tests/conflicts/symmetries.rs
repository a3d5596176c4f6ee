//! Changes that must not change a conflict.

use proptest::prelude::*;
use roadplane_traffic::{Clip, Conflict, ConflictKind, State, Vehicle, conflicts};

use crate::{all, car, clip, uniform};

/// Two cars that come near the origin at some angle and time.
fn pairs() -> impl Strategy<Value = Vec<Vehicle>> {
    let car_of = |track: u64| {
        (4.0..16.0_f64, 0.0..std::f64::consts::TAU, 2.0..6.0_f64, -0.5..0.5_f64).prop_map(
            move |(speed_mps, heading_rad, at_origin_s, aside_m)| {
                let (sin, cos) = heading_rad.sin_cos();
                let back_m = speed_mps * at_origin_s;
                let start_m = [-back_m * cos - aside_m * sin, -back_m * sin + aside_m * cos];
                let mut car = car(track, [0.0, 8.0], &uniform(start_m, heading_rad, speed_mps));
                for state in &mut car.states {
                    state.own_sd_m = [0.2, 0.3];
                    state.own_speed_sd_mps = 0.2;
                }
                car
            },
        )
    };
    (car_of(1), car_of(2)).prop_map(|(a, b)| vec![a, b])
}

fn of(vehicles: Vec<Vehicle>) -> Vec<Conflict> {
    conflicts(&clip(vehicles, Some(0.05)), &all())
}

fn changed(vehicles: &[Vehicle], change: impl Fn(&State) -> State) -> Vec<Vehicle> {
    let vehicle = |v: &Vehicle| Vehicle { states: v.states.iter().map(&change).collect(), ..v.clone() };
    vehicles.iter().map(vehicle).collect()
}

/// Compares figures; times and places are left out.
fn same(a: &[Conflict], b: &[Conflict], tolerance: f64) -> Result<(), TestCaseError> {
    prop_assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(b) {
        prop_assert_eq!(a.kind, b.kind);
        for (x, y) in [
            (a.pet_s, b.pet_s),
            (a.min_ttc_s, b.min_ttc_s),
            (a.max_drac_mps2, b.max_drac_mps2),
            (a.pet_below_p, b.pet_below_p),
        ] {
            prop_assert_eq!(x.is_some(), y.is_some(), "{:?} {:?}", a, b);
            let (x, y) = (x.unwrap_or(0.0), y.unwrap_or(0.0));
            prop_assert!((x - y).abs() <= tolerance * (1.0 + x.abs()), "{} {} {:?} {:?}", x, y, a, b);
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_numbers_of_the_tracks_do_not_matter(pair in pairs()) {
        let before = of(pair.clone());
        let swapped: Vec<Vehicle> = pair.iter().rev().map(|v| Vehicle { track: 3 - v.track, ..v.clone() }).collect();
        let after = of(swapped);
        same(&before, &after, 1e-4)?;
        for (a, b) in before.iter().zip(&after) {
            // Vehicles that meet head-on may enter at once: then the numbers decide who is first.
            let at_once = a.kind == ConflictKind::Oncoming;
            prop_assert!(at_once || (a.first, a.second) == (3 - b.first, 3 - b.second), "{:?} {:?}", a, b);
            prop_assert!((a.x_m - b.x_m).abs() < 1e-6 && (a.at_s - b.at_s).abs() < 1e-6);
        }
    }

    #[test]
    fn place_direction_and_time_of_the_clip_do_not_matter(
        pair in pairs(), turn_rad in -3.0..3.0_f64, x_m in -100.0..100.0_f64, later_s in 0.0..1000.0_f64
    ) {
        let (sin, cos) = turn_rad.sin_cos();
        let moved = changed(&pair, |s| State {
            time_s: s.time_s + later_s,
            x_m: cos * s.x_m - sin * s.y_m + x_m,
            y_m: sin * s.x_m + cos * s.y_m - 2.0 * x_m,
            heading_rad: s.heading_rad + turn_rad as f32,
            own_sd_m: [0.2, 0.2],
            ..*s
        });
        let before = of(changed(&pair, |s| State { own_sd_m: [0.2, 0.2], ..*s }));
        let after = of(moved);
        // Headings are stored with 24 bits, so a rare contact at a corner is found in one case only.
        prop_assume!(before.len() == after.len());
        prop_assume!(before.iter().zip(&after).all(|(a, b)| a.min_ttc_s.is_some() == b.min_ttc_s.is_some()));
        prop_assume!(before.iter().zip(&after).all(|(a, b)| a.pet_s.is_some() == b.pet_s.is_some()));
        prop_assume!(before.iter().zip(&after).all(|(a, b)| a.max_drac_mps2.is_some() == b.max_drac_mps2.is_some()));
        same(&before, &after, 0.02)?;
        for (a, b) in before.iter().zip(&after) {
            prop_assert!((a.at_s + later_s - b.at_s).abs() < 0.11);
        }
    }

    #[test]
    fn times_do_not_depend_on_the_metric_scale(pair in pairs(), scale in 0.8..1.25_f64) {
        let resized = |clip: Clip| Clip {
            vehicles: changed(&clip.vehicles, |s| State {
                x_m: s.x_m * scale,
                y_m: s.y_m * scale,
                speed_mps: (f64::from(s.speed_mps) * scale) as f32,
                own_sd_m: s.own_sd_m.map(|sd| (f64::from(sd) * scale) as f32),
                own_speed_sd_mps: (f64::from(s.own_speed_sd_mps) * scale) as f32,
                ..*s
            })
            .into_iter()
            .map(|v| Vehicle { length_m: v.length_m * scale, width_m: v.width_m * scale, ..v })
            .collect(),
            ..clip
        };
        let before = of(pair.clone());
        let after = conflicts(&resized(clip(pair, Some(0.05))), &all());
        prop_assume!(before.iter().zip(&after).all(|(a, b)| a.min_ttc_s.is_some() == b.min_ttc_s.is_some()));
        prop_assume!(before.iter().zip(&after).all(|(a, b)| a.max_drac_mps2.is_some() == b.max_drac_mps2.is_some()));
        prop_assert_eq!(before.len(), after.len());
        for (a, b) in before.iter().zip(&after) {
            if let (Some(x), Some(y)) = (a.pet_s, b.pet_s) {
                prop_assert!((x - y).abs() < 0.02, "{} {}", x, y);
            }
            if let (Some(x), Some(y)) = (a.min_ttc_s, b.min_ttc_s) {
                prop_assert!((x - y).abs() < 0.02 * (1.0 + x), "{} {}", x, y);
            }
            if let (Some(x), Some(y)) = (a.max_drac_mps2, b.max_drac_mps2) {
                prop_assume!(x.max(y) < 14.0);
                prop_assert!((x * scale - y).abs() < 0.03 * (1.0 + y), "{} {}", x * scale, y);
            }
        }
    }

    #[test]
    fn any_numbers_are_accepted(
        numbers in proptest::collection::vec(prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(0.0), -1e6..1e6_f64], 24)
    ) {
        let vehicle = |track: u64, n: &[f64]| Vehicle {
            states: n.chunks(4).enumerate().map(|(i, n)| State {
                time_s: i as f64,
                x_m: n[0], y_m: n[1], heading_rad: n[2] as f32, speed_mps: n[3] as f32,
                own_sd_m: [n[0] as f32, n[1] as f32], own_speed_sd_mps: n[2] as f32, ..State::default()
            }).collect(),
            length_m: if n[0] > 0.0 { 4.5 } else { n[1] },
            ..car(track, [0.0, 0.0], &uniform([0.0; 2], 0.0, 1.0))
        };
        let found = of(vec![vehicle(1, &numbers[..12]), vehicle(2, &numbers[12..])]);
        prop_assert!(found.len() <= 1);
    }
}
