//! Compares the features in Rust with those in Python. Tests the shipped net if the ONNX runtime is installed.

use std::path::{Path, PathBuf};

use roadplane_activity::{ActivityError, ActivityNet, FEATURES, Label, Motion, features};
use roadplane_infer::{ProviderChoice, SessionOptions, find_library};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

#[test]
fn features_agree_with_pythons() {
    let text = std::fs::read_to_string(root().join("tests/data/activity/features.json")).unwrap();
    let fixture: serde_json::Value = serde_json::from_str(&text).unwrap();
    let cases = fixture["cases"].as_array().unwrap();
    assert!(cases.len() >= 4);
    for case in cases {
        let read = |key: &str| case[key].clone();
        let motion = Motion {
            time_s: serde_json::from_value(read("time_s")).unwrap(),
            xy_m: serde_json::from_value(read("xy_m")).unwrap(),
            heading_rad: serde_json::from_value(read("heading_rad")).unwrap(),
            sd_m: serde_json::from_value(read("sd_m")).unwrap(),
            ..Motion::default()
        };
        motion.check().unwrap();
        let steps: Vec<i64> = serde_json::from_value(read("steps")).unwrap();
        let expected: Vec<[f64; FEATURES]> = serde_json::from_value(read("features")).unwrap();
        let found = features(&motion, &steps);
        assert_eq!(found.len(), expected.len());
        for (step, (found, expected)) in found.iter().zip(&expected).enumerate() {
            for i in 0..FEATURES {
                let difference = (f64::from(found[i]) - expected[i]).abs();
                assert!(difference < 5e-5, "step {step}, feature {i}: {} {}", found[i], expected[i]);
            }
        }
    }
}

fn net() -> Option<Result<ActivityNet, ActivityError>> {
    if find_library(None).is_err() {
        eprintln!("skipped: the ONNX runtime is not found");
        return None;
    }
    let options = SessionOptions { provider: ProviderChoice::Cpu, threads: 1, library: None };
    Some(ActivityNet::open(&root().join("models/activity.card.json"), &options))
}

/// Returns the motion of a car that starts from rest, drives at 6 m/s, and brakes to rest. There are `hz` samples per
/// second.
fn drive(hz: f64) -> Motion {
    let driven_m = |t: f64| {
        let t = t - 4.0;
        let (start, cruise, brake) =
            (t.clamp(0.0, 4.0), (t - 4.0).clamp(0.0, 5.0), (t - 9.0).clamp(0.0, 4.0));
        0.75 * start * start + 6.0 * cruise + 6.0 * brake - 0.75 * brake * brake
    };
    let time_s: Vec<f64> = (0..(22.0 * hz) as usize).map(|i| i as f64 / hz).collect();
    let xy_m = time_s.iter().map(|t| [driven_m(*t), 20.0]).collect();
    Motion {
        heading_rad: vec![0.0; time_s.len()],
        sd_m: vec![[0.1, 0.2]; time_s.len()],
        time_s,
        xy_m,
        ..Motion::default()
    }
}

#[test]
fn a_drive_from_rest_to_rest_at_any_frame_rate() {
    let Some(net) = net() else { return };
    let mut net = net.unwrap();
    let mut events = Vec::new();
    for hz in [5.0, 7.5, 10.0, 15.0, 30.0] {
        let found = net.label(&drive(hz)).unwrap();
        let names: Vec<Label> = found.intervals.iter().map(|(label, ..)| *label).collect();
        assert_eq!(
            names,
            [Label::Starting, Label::Moving, Label::Stopping],
            "at {hz} Hz: {:?}",
            found.intervals
        );
        events.push(found.intervals);
    }
    for other in &events[1..] {
        for (a, b) in events[0].iter().zip(other) {
            assert!((a.1 - b.1).abs() <= 0.3 && (a.2 - b.2).abs() <= 0.3, "{a:?} {b:?}");
        }
    }
}

#[test]
fn a_shaking_parked_car_is_stationary() {
    let Some(net) = net() else { return };
    let mut net = net.unwrap();
    let mut motion = drive(10.0);
    for (i, (xy, t)) in motion.xy_m.iter_mut().zip(&motion.time_s).enumerate() {
        let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
        *xy = [0.15 * (1.7 * t).sin() + 0.05 * sign, 20.0 + 0.2 * (1.1 * t).cos()];
    }
    let found = net.label(&motion).unwrap();
    assert!(found.intervals.is_empty(), "{:?}", found.intervals);
    assert!(found.samples.iter().all(|(label, p)| *label == Label::NotMoving && *p > 0.5));
}

#[test]
fn left_is_right_in_the_mirror() {
    let Some(net) = net() else { return };
    let mut net = net.unwrap();
    let time_s: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.1).collect();
    // The car drives at 5 m/s. Between 3.5 and 6 s, it makes a quarter turn to the left with a radius of 8 m.
    let heading: Vec<f64> = time_s.iter().map(|t| (t - 3.5).clamp(0.0, 2.513) * 5.0 / 8.0).collect();
    let mut at = [0.0, 0.0];
    let mut xy_m = Vec::new();
    for angle in &heading {
        xy_m.push(at);
        at = [at[0] + 0.5 * angle.cos(), at[1] + 0.5 * angle.sin()];
    }
    let left = Motion { time_s, xy_m, heading_rad: heading, ..Motion::default() };
    let mut right = left.clone();
    right.xy_m.iter_mut().for_each(|xy| xy[1] = -xy[1]);
    right.heading_rad.iter_mut().for_each(|angle| *angle = -*angle);
    let (left, right) = (net.label(&left).unwrap(), net.label(&right).unwrap());
    assert!(left.intervals.iter().any(|(label, ..)| *label == Label::TurningLeft), "{:?}", left.intervals);
    for (a, b) in left.samples.iter().zip(&right.samples) {
        let mirrored = match a.0 {
            Label::TurningLeft => Label::TurningRight,
            other => other,
        };
        assert_eq!(mirrored, b.0);
        assert!((a.1 - b.1).abs() < 1e-4);
    }
}
