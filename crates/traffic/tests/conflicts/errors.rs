//! Sds against the scatter of simulated errors.

use std::f64::consts::FRAC_PI_2;

use roadplane_traffic::{Conflict, State, Vehicle, conflicts};

use crate::{all, car, clip, uniform};

const OWN_SD_M: [f64; 2] = [0.25, 0.35];
const SPEED_SD_MPS: f64 = 0.3;
const SCALE_SD: f64 = 0.04;

/// Standard normal numbers from a fixed seed: SplitMix64, and the sum of twelve uniform numbers.
struct Normal(u64);

impl Normal {
    fn draw(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// Adds an error of position and speed to each vehicle, and one of the scale to all.
fn measured(truth: &[Vehicle], normal: &mut Normal) -> Vec<Vehicle> {
    let scale = 1.0 + SCALE_SD * normal.draw();
    let one = |vehicle: &Vehicle, normal: &mut Normal| {
        let [x, y] = OWN_SD_M.map(|sd| sd * normal.draw());
        let faster = SPEED_SD_MPS * normal.draw();
        let state = |s: &State| State {
            x_m: (s.x_m + x) * scale,
            y_m: (s.y_m + y) * scale,
            speed_mps: ((f64::from(s.speed_mps) + faster) * scale) as f32,
            own_sd_m: OWN_SD_M.map(|sd| sd as f32),
            own_speed_sd_mps: SPEED_SD_MPS as f32,
            ..*s
        };
        Vehicle {
            states: vehicle.states.iter().map(state).collect(),
            length_m: vehicle.length_m * scale,
            width_m: vehicle.width_m * scale,
            ..vehicle.clone()
        }
    };
    truth.iter().map(|vehicle| one(vehicle, normal)).collect()
}

/// A figure of a conflict and its sd.
type Figure = fn(&Conflict) -> Option<(f64, Option<f64>)>;

const PET: Figure = |c| Some((c.pet_s?, c.pet_sd_s));
const TTC: Figure = |c| Some((c.min_ttc_s?, c.min_ttc_sd_s));
const DRAC: Figure = |c| Some((c.max_drac_mps2?, c.max_drac_sd_mps2));

/// Checks the rms of the normalised error.
fn check(truth: &[Vehicle], figure: Figure) {
    let exact = conflicts(&clip(truth.to_vec(), None), &all());
    assert_eq!(exact.len(), 1);
    let (true_value, no_sd) = figure(&exact[0]).unwrap();
    assert_eq!(no_sd, None, "tracks without sds");
    let mut normal = Normal(20_26);
    let (mut squares, mut count) = (0.0, 0.0);
    for _ in 0..400 {
        let found = conflicts(&clip(measured(truth, &mut normal), Some(SCALE_SD)), &all());
        let Some((value, sd)) = found.first().and_then(figure) else { continue };
        squares += ((value - true_value) / sd.unwrap()).powi(2);
        count += 1.0;
    }
    let rms = f64::sqrt(squares / count);
    println!("normalised error: {rms:.3}, found {count} of 400");
    assert!(count >= 390.0, "found {count} of 400");
    assert!((0.7..1.3).contains(&rms), "the normalised error has an rms of {rms}");
}

#[test]
fn pet_at_a_crossing() {
    for angle_rad in [FRAC_PI_2, 1.0, 2.0] {
        let along = 10.0 * 4.7;
        let start = [-along * f64::cos(angle_rad), -along * f64::sin(angle_rad)];
        let truth = [
            car(1, [0.0, 9.0], &uniform([-30.0, 0.0], 0.0, 10.0)),
            car(2, [0.0, 9.0], &uniform(start, angle_rad, 10.0)),
        ];
        check(&truth, PET);
    }
}

#[test]
fn ttc_and_drac_of_a_follower() {
    let truth = [
        car(1, [0.0, 2.0], &uniform([32.0, 0.0], 0.2, 8.0)),
        car(2, [0.0, 2.0], &uniform([0.0, -6.4], 0.2, 15.0)),
    ];
    check(&truth, TTC);
    check(&truth, DRAC);
}

#[test]
fn ttc_and_drac_at_a_crossing() {
    // Both tracks end before the contact that is expected 1.5 s later.
    let truth = [
        car(1, [0.0, 1.0], &uniform([-19.0 - 3.15, 0.0], 0.0, 9.0)),
        car(2, [0.0, 1.0], &uniform([0.0, -25.0 - 3.15], FRAC_PI_2, 10.0)),
    ];
    check(&truth, TTC);
    check(&truth, DRAC);
}

#[test]
fn probabilities_of_times_in_a_lane_are_calibrated() {
    // The probability that TTC is below its limit is the share of simulated truths below it: gap and closing speed of a
    // measurement, changed by the own errors.
    let mut normal = Normal(7);
    let truth = [
        car(1, [0.0, 1.0], &uniform([22.0, 0.0], 0.0, 8.0)),
        car(2, [0.0, 1.0], &uniform([0.0, 0.0], 0.0, 14.0)),
    ];
    let limits = all();
    let with_sds: Vec<Vehicle> = truth
        .iter()
        .map(|v| Vehicle {
            states: v
                .states
                .iter()
                .map(|s| State { own_sd_m: [0.25, 0.35], own_speed_sd_mps: 0.8, ..*s })
                .collect(),
            ..v.clone()
        })
        .collect();
    let found =
        conflicts(&clip(with_sds, Some(0.0)), &roadplane_traffic::ConflictLimits { ttc_s: 1.7, ..limits });
    let p = found[0].min_ttc_below_p.unwrap();
    let (gap_m, closing_mps) = (22.0 - 4.5 - 6.0, 6.0);
    let below = (0..20_000).filter(|_| {
        let gap = gap_m + 0.25 * (normal.draw() - normal.draw());
        let closing = closing_mps + 0.8 * (normal.draw() - normal.draw());
        gap < 1.7 * closing
    });
    let share = below.count() as f64 / 20_000.0;
    assert!((p - share).abs() < 0.01, "{p} {share}");
}
