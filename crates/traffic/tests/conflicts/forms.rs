//! Closed forms.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector2;
use roadplane_traffic::{ConflictKind, ConflictLimits, Projection, conflicts};

use crate::{all, car, clip, near, only, place, uniform};

#[test]
fn crossing_at_right_angles_without_expected_contact() {
    // Car 1 goes east and is at the origin at 3 s; its rear leaves the strip of car 2 (x < 0.9) at 3 + (0.9 + 2.25)/10.
    // Car 2 goes north and is at the origin at 5 s; its front enters the strip of car 1 at 5 − (0.9 + 2.25)/8.
    let east = car(1, [0.0, 8.0], &uniform([-30.0, 0.0], 0.0, 10.0));
    let north = car(2, [0.0, 8.0], &uniform([0.0, -40.0], FRAC_PI_2, 8.0));
    let found = only(vec![east, north]);
    assert_eq!((found.first, found.second, found.kind), (1, 2, ConflictKind::Crossing));
    let enters_s = 5.0 - 3.15 / 8.0;
    near(found.pet_s, enters_s - (3.0 + 0.315), 1e-4);
    assert!((found.at_s - enters_s).abs() < 1e-4 && (found.angle_deg - 90.0).abs() < 1e-3);
    assert!((place(&found) - Vector2::new(0.0, -0.9)).norm() < 2.5, "{:?}", place(&found));
    assert_eq!((found.min_ttc_s, found.max_drac_mps2), (None, None));
    assert_eq!((found.pet_serious_p, found.pet_sd_s), (Some(1.0), None));
}

#[test]
fn crossing_at_right_angles_on_a_collision_course() {
    // Car 2 is 20 m from the strip at 0 s and goes 10 m/s. It brakes at 1 s, so that it lets car 1 pass.
    // Car 1 is 19 m from the strip and leaves it after t = (19 + 1.8 + 4.5)/10 s.
    let first = car(1, [0.0, 10.0], &uniform([-19.0 - 3.15, 0.0], 0.0, 10.0));
    let second = car(2, [0.0, 10.0], &|time_s| {
        let braking_s = (time_s - 1.0).clamp(0.0, 10.0 / 6.0);
        let along_m = 10.0 * time_s.min(1.0) + 10.0 * braking_s - 3.0 * braking_s * braking_s;
        let again_m = (time_s - 4.0).max(0.0).powi(2);
        (
            [0.0, -20.0 - 3.15 + along_m + again_m],
            FRAC_PI_2,
            10.0 - 6.0 * braking_s + 2.0 * (time_s - 4.0).max(0.0),
        )
    });
    let found = only(vec![first, second]);
    assert_eq!((found.first, found.second, found.kind), (1, 2, ConflictKind::Crossing));
    // At 1 s: car 2 has 10 m to the strip at 10 m/s.
    // While it brakes, d/v first falls: it is lowest at the last moment with an expected contact.
    let (d_m, t_s): (f64, f64) = (10.0, 1.53);
    let drac = 2.0 * (10.0 - d_m / t_s) / t_s;
    assert!(found.max_drac_mps2.unwrap() >= drac - 0.02, "{found:?} {drac}");
    assert!(found.min_ttc_s.unwrap() <= 1.0 + 1e-6);
    let braking = |s: f64| (10.0 - 6.0 * s, 10.0 - (10.0 * s - 3.0 * s * s), 1.53 - s);
    let times = (0..=53).map(|i| braking(f64::from(i) / 100.0));
    let expected = times.filter(|(v, d, t)| d / v <= *t).map(|(v, d, _)| d / v).fold(f64::INFINITY, f64::min);
    near(found.min_ttc_s, expected, 0.1);
}

#[test]
fn deceleration_at_a_crossing_has_almqvist_s_form() {
    // Both keep their speeds and the tracks end before the contact.
    for (first_mps, first_m) in [(10.0, 15.0), (6.0, 12.0), (3.0, 4.0)] {
        let second_mps: f64 = 12.0;
        let d_m: f64 = 25.0;
        let first = car(1, [0.0, 0.1], &uniform([-first_m - 3.15, 0.0], 0.0, first_mps));
        let second = car(2, [0.0, 0.1], &uniform([0.0, -d_m - 3.15], FRAC_PI_2, second_mps));
        let found = only(vec![first, second]);
        // The highest value is that at 0.1 s. Either vehicle can brake.
        let (first_m, second_m) = (first_m - first_mps * 0.1, d_m - second_mps * 0.1);
        near(found.min_ttc_s, second_m / second_mps, 1e-3);
        let needed = |d_m: f64, mps: f64, t_s: f64| {
            let stops = mps.powi(2) / (2.0 * d_m);
            if d_m < mps * t_s / 2.0 { stops } else { 2.0 * (mps - d_m / t_s) / t_s }
        };
        let by_second = needed(second_m, second_mps, (first_m + 6.3) / first_mps);
        let by_first = needed(first_m, first_mps, (second_m + 6.3) / second_mps);
        near(found.max_drac_mps2, by_second.min(by_first), 0.02 * by_second);
    }
}

#[test]
fn following_with_constant_speeds() {
    // Gap at 0 s: 30 − 4.5 m, at 2 s: 15.5 m, closing at 5 m/s.
    let leader = car(7, [0.0, 2.0], &uniform([30.0, 0.0], 0.0, 10.0));
    let follower = car(3, [0.0, 2.0], &uniform([0.0, 0.3], 0.0, 15.0));
    let found = only(vec![follower, leader]);
    assert_eq!((found.first, found.second, found.kind), (7, 3, ConflictKind::Following));
    near(found.min_ttc_s, 15.5 / 5.0, 1e-3);
    near(found.max_drac_mps2, 25.0 / (2.0 * 15.5), 0.01);
    near(found.relative_speed_mps, 5.0, 1e-3);
    assert_eq!((found.pet_s, found.min_ttc_at_s), (None, Some(2.0)));
    let front_m = 15.0 * (2.0 + 15.5 / 5.0) + 2.25;
    assert!((place(&found) - Vector2::new(front_m, 0.15)).norm() < 0.2, "{:?}", place(&found));
}

#[test]
fn a_leader_that_brakes() {
    // The leader brakes at 4 m/s² from 1 s on, the follower from 2 s on at 5 m/s²; both from 15 m/s, gap 20 m.
    let braking = |start_m: f64, from_s: f64, rate: f64| {
        move |time_s: f64| {
            let s = (time_s - from_s).clamp(0.0, 15.0 / rate);
            ([start_m + 15.0 * time_s.min(from_s) + 15.0 * s - rate * s * s / 2.0, 0.0], 0.0, 15.0 - rate * s)
        }
    };
    let (lead, follow) = (braking(24.5, 1.0, 4.0), braking(0.0, 2.0, 5.0));
    let found = only(vec![car(1, [0.0, 7.0], &lead), car(2, [0.0, 7.0], &follow)]);
    let (mut ttc, mut drac) = (f64::INFINITY, 0.0_f64);
    for i in 0..=70 {
        let time_s = f64::from(i) / 10.0;
        let (([ahead, _], _, v1), ([behind, _], _, v2)) = (lead(time_s), follow(time_s));
        let (gap, closing) = (ahead - behind - 4.5, v2 - v1);
        if closing > 1e-6 {
            ttc = ttc.min(gap / closing);
            drac = drac.max(closing * closing / (2.0 * gap));
        }
    }
    near(found.min_ttc_s, ttc, 0.01);
    near(found.max_drac_mps2, drac, 0.02 * drac);
}

#[test]
fn a_stationary_obstacle() {
    // The car brakes at 5 m/s² from 14 m/s and stops 2 m before the obstacle.
    let stops_m = 14.0 * 14.0 / 10.0;
    let drive = move |time_s: f64| {
        let s = (time_s - 1.0).clamp(0.0, 14.0 / 5.0);
        ([-stops_m + 14.0 * time_s.min(1.0) - 14.0 + 14.0 * s - 2.5 * s * s, 0.0], 0.0, 14.0 - 5.0 * s)
    };
    let obstacle = car(9, [0.0, 6.0], &uniform([4.5 + 2.0, 0.0], 0.0, 0.0));
    let found = only(vec![car(1, [0.0, 6.0], &drive), obstacle]);
    assert_eq!((found.first, found.second, found.kind), (9, 1, ConflictKind::Following));
    // (d + 2)/v with d = v²/10 is lowest at v² = 20: 2·√20/10.
    near(found.min_ttc_s, 2.0 * 20.0_f64.sqrt() / 10.0, 0.02);
    let drac = 14.0 * 14.0 / (2.0 * (stops_m + 2.0));
    near(found.max_drac_mps2, drac, 0.01 * drac);
}

#[test]
fn merging_vehicles() {
    // Car 2 comes from the right on a curve of radius 10 m and follows car 1 after it.
    let curve = |time_s: f64| {
        let along_m = 6.0 * (time_s - 4.0);
        if along_m < 0.0 {
            ([-10.0, -10.0 + along_m], FRAC_PI_2, 6.0)
        } else if along_m < 5.0 * PI {
            let angle = along_m / 10.0;
            ([-10.0 * angle.cos(), -10.0 + 10.0 * angle.sin()], FRAC_PI_2 - angle, 6.0)
        } else {
            ([along_m - 5.0 * PI, 0.0], 0.0, 6.0)
        }
    };
    let straight = car(1, [0.0, 12.0], &uniform([-28.0, 0.0], 0.0, 7.0));
    let found = only(vec![straight, car(2, [0.0, 12.0], &curve)]);
    assert_eq!((found.first, found.second, found.kind), (1, 2, ConflictKind::Merging));
    // Car 1 leaves the place of the entry when its rear passes the left front corner of car 2.
    let pet_s = found.pet_s.unwrap();
    let entry = curve(found.at_s);
    let (sin, cos) = entry.1.sin_cos();
    let corner = [1.0, -1.0].map(|side| entry.0[0] + 2.25 * cos - side * 0.9 * sin);
    let leaves_s = (corner[0].max(corner[1]) + 28.0 + 2.25) / 7.0;
    assert!(pet_s > 0.0 && (found.at_s - pet_s - leaves_s).abs() < 0.4, "{found:?} {leaves_s}");
    assert!(found.min_ttc_s.is_none(), "{found:?}");
}

#[test]
fn a_vehicle_behind_one_that_turned_into_its_lane() {
    let turned = |time_s: f64| {
        let angle = (time_s * 0.5).min(FRAC_PI_2);
        let on_m = 5.0 * (time_s - PI).max(0.0);
        ([-10.0 * angle.cos() + on_m, -10.0 + 10.0 * angle.sin()], FRAC_PI_2 - angle, 5.0)
    };
    let behind = car(2, [0.0, 8.0], &uniform([-45.0, 0.0], 0.0, 7.0));
    let found = only(vec![car(1, [0.0, 8.0], &turned), behind]);
    assert_eq!((found.first, found.second, found.kind), (1, 2, ConflictKind::Merging));
    assert!(found.pet_s.is_some_and(|pet| (1.0..5.0).contains(&pet)), "{found:?}");
    assert!(found.min_ttc_s.is_some(), "car 2 catches up with car 1");
}

#[test]
fn vehicles_that_meet_in_their_own_lanes_have_no_conflict() {
    let east = car(1, [0.0, 10.0], &uniform([-50.0, 0.0], 0.0, 10.0));
    let west = car(2, [0.0, 10.0], &uniform([50.0, 3.5], PI, 10.0));
    let beside = car(3, [0.0, 10.0], &uniform([-50.0, -3.5], 0.0, 10.5));
    let late = car(4, [30.0, 40.0], &uniform([0.0, -330.0], FRAC_PI_2, 10.0));
    assert!(conflicts(&clip(vec![east, west, beside, late], None), &all()).is_empty());
}

#[test]
fn oncoming_vehicles_cannot_avoid_a_contact_alone() {
    let east = car(1, [0.0, 1.0], &uniform([0.0, 0.0], 0.0, 10.0));
    let west = car(2, [0.0, 1.0], &uniform([60.0, 0.5], PI, 10.0));
    let found = only(vec![east, west]);
    assert_eq!((found.kind, found.max_drac_mps2), (ConflictKind::Oncoming, None));
    near(found.min_ttc_s, (40.0 - 4.5) / 20.0, 1e-3);
}

#[test]
fn on_a_curve_only_the_straight_projection_expects_a_contact_with_the_oncoming_lane() {
    // Two lanes with radii of 30 and 34 m, in opposite directions.
    let arc = |radius_m: f64, phase_m: f64, sense: f64| {
        move |time_s: f64| {
            let angle = sense * (10.0 * time_s + phase_m) / radius_m;
            let heading = if sense > 0.0 { angle + FRAC_PI_2 } else { angle - FRAC_PI_2 };
            ([radius_m * angle.cos(), radius_m * angle.sin()], heading, 10.0)
        }
    };
    let vehicles =
        vec![car(1, [0.0, 5.0], &arc(30.0, 0.0, 1.0)), car(2, [0.0, 5.0], &arc(34.0, -80.0, -1.0))];
    let by_path = conflicts(&clip(vehicles.clone(), None), &all());
    assert!(by_path.iter().all(|c| c.min_ttc_at_s.is_none_or(|s| s > 4.0)), "{by_path:?}");
    let limits = ConflictLimits { projection: Projection::Straight, ..all() };
    assert!(!conflicts(&clip(vehicles, None), &limits).is_empty());
}

#[test]
fn both_projections_agree_on_straight_roads() {
    let leader = car(1, [0.0, 4.0], &uniform([30.0, 0.0], 0.3, 10.0));
    let follower = car(2, [0.0, 4.0], &uniform([0.0, -9.0], 0.3, 15.0));
    let clip = clip(vec![leader, follower], None);
    let [path, straight] = [Projection::Path, Projection::Straight]
        .map(|projection| conflicts(&clip, &ConflictLimits { projection, ..all() }).remove(0));
    near(path.min_ttc_s, straight.min_ttc_s.unwrap(), 1e-4);
    near(path.max_drac_mps2, straight.max_drac_mps2.unwrap(), 1e-3);
}
