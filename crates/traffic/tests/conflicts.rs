//! Conflicts against closed forms, symmetries, and simulated errors.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on has failed")]

#[path = "conflicts/errors.rs"]
mod errors;
#[path = "conflicts/forms.rs"]
mod forms;
#[path = "conflicts/symmetries.rs"]
mod symmetries;

use nalgebra::Vector2;
use roadplane_base::VehicleClass;
use roadplane_traffic::{Clip, Conflict, ConflictLimits, State, Vehicle, conflicts};

/// A path over time: position (m) and heading (rad), speed (m/s).
type Drive<'a> = &'a dyn Fn(f64) -> ([f64; 2], f64, f64);

/// A car of 4.5 m × 1.8 m with states every 0.1 s.
fn car(track: u64, span_s: [f64; 2], drive: Drive<'_>) -> Vehicle {
    let steps = ((span_s[1] - span_s[0]) * 10.0).round() as usize;
    let state = |i: usize| {
        let time_s = span_s[0] + i as f64 / 10.0;
        let ([x_m, y_m], heading_rad, speed_mps) = drive(time_s);
        State {
            time_s,
            x_m,
            y_m,
            heading_rad: heading_rad as f32,
            speed_mps: speed_mps as f32,
            ..State::default()
        }
    };
    Vehicle {
        track,
        class: VehicleClass::Car,
        length_m: 4.5,
        width_m: 1.8,
        length_sd_m: 0.0,
        exists_p: 1.0,
        states: (0..=steps).map(state).collect(),
    }
}

/// A uniform straight motion: position at time 0 (m), heading (rad), speed (m/s).
fn uniform(start_m: [f64; 2], heading_rad: f64, speed_mps: f64) -> impl Fn(f64) -> ([f64; 2], f64, f64) {
    move |time_s| {
        let (sin, cos) = heading_rad.sin_cos();
        let along_m = speed_mps * time_s;
        ([start_m[0] + along_m * cos, start_m[1] + along_m * sin], heading_rad, speed_mps)
    }
}

fn clip(vehicles: Vec<Vehicle>, scale_sd: Option<f64>) -> Clip {
    Clip {
        name: "test".into(),
        start_s: None,
        span_s: [0.0, 100.0],
        not_followed_s: Vec::new(),
        scale_sd,
        vehicles,
    }
}

/// Limits that list every conflict.
fn all() -> ConflictLimits {
    ConflictLimits {
        pet_s: 10.0,
        ttc_s: 5.0,
        listed_p: 0.0,
        least_speed_mps: 0.0,
        ..ConflictLimits::default()
    }
}

fn only(vehicles: Vec<Vehicle>) -> Conflict {
    let mut found = conflicts(&clip(vehicles, None), &all());
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

#[track_caller]
fn near(value: Option<f64>, expected: f64, tolerance: f64) {
    let value = value.expect("a value");
    assert!((value - expected).abs() <= tolerance, "{value} instead of {expected}");
}

fn place(conflict: &Conflict) -> Vector2<f64> {
    Vector2::new(conflict.x_m, conflict.y_m)
}
