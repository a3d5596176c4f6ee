//! Tests runs of real surveillance video. The tests need data that only developers have.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::{json, json_lines, number, roadplane, shared};
use serde_json::Value;

/// Runs an input. Returns its camera, its rows by track, and its summary.
fn run(input: &Path, code: i32, settings: &[&str]) -> (Value, BTreeMap<u64, Vec<Value>>, Value) {
    let out = tempfile::tempdir().unwrap();
    let mut command = roadplane();
    command.arg("run").arg(input).arg("--out").arg(out.path());
    for setting in settings {
        command.args(["--set", setting]);
    }
    command.assert().code(code);
    let result = out.path().join(input.file_stem().unwrap());
    let mut tracks: BTreeMap<u64, Vec<Value>> = BTreeMap::new();
    for row in json_lines(&result.join("tracks.jsonl")) {
        tracks.entry(row["track"].as_u64().unwrap()).or_default().push(row);
    }
    (json(&result.join("camera.json")), tracks, json(&result.join("summary.json")))
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn nine_parked_cars_stay_where_they_are() {
    let clip = shared("virat/virat_0401_lot.mp4");
    let (camera, tracks, _) = run(&clip, 0, &["decode.stride=5"]);
    assert!((6.0..15.0).contains(&number(&camera["height_m"])), "{camera}");
    assert!((9..=10).contains(&tracks.len()), "{} tracks", tracks.len());
    for rows in tracks.values() {
        let spread = |field: &str| {
            let values: Vec<f64> = rows.iter().map(|row| number(&row[field])).collect();
            values.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b))
                - values.iter().fold(f64::INFINITY, |a, b| a.min(*b))
        };
        assert!(spread("x_m") <= 0.1 && spread("y_m") <= 0.1 && spread("heading_rad") <= 0.026);
        assert!(rows.iter().all(|row| number(&row["speed_mps"]).abs() < 0.2));
    }
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn a_damaged_clip_runs_through_and_its_damage_is_reported() {
    let clip = shared("virat/virat_0002_lot.mp4");
    let (_, tracks, summary) = run(&clip, 3, &["decode.stride=5"]);
    assert!(summary["warnings"].as_array().unwrap().iter().any(|w| w.as_str().unwrap().contains("broken")));
    assert!(tracks.len() >= 14, "{} tracks", tracks.len());
    let driving: Vec<f64> = tracks
        .values()
        .filter_map(|rows| rows.iter().map(|row| number(&row["speed_mps"]).abs()).reduce(f64::max))
        .filter(|speed| *speed > 3.0)
        .collect();
    assert!(!driving.is_empty() && driving.iter().all(|speed| *speed < 20.0), "{driving:?}");
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn a_calibrated_still_is_recovered() {
    let still = shared("meva/G424.png");
    let (camera, _, _) = run(&still, 0, &[]);
    // The calibration of the still gives 4005 px, and a tilt of 7.3° below the horizontal.
    assert!((0.8..1.25).contains(&(number(&camera["focal_px"]) / 4005.0)), "{camera}");
    assert!((number(&camera["tilt_rad"]).to_degrees() - 7.3).abs() < 2.0, "{camera}");
}
