//! Compares the output of each stage with stored values, for three frames of the demo clip. The stages give pixels,
//! boxes, keypoints, camera and tracks.
//!
//! A person has checked the stored values. This command stores new values:
//! `ROADPLANE_GOLDEN=write cargo test -p roadplane --test e2e golden_chain`.

use std::fs;
use std::path::PathBuf;

use roadplane_decode::{DecodeOptions, open};
use serde_json::{Value, json};

use crate::common::{json, json_lines, roadplane, root};

const FRAMES: u64 = 3;

/// Largest difference from the stored value, by field. The last digits of nets in f32 differ between processors.
const TOLERANCES: [(&str, f64); 9] = [
    ("bbox_px", 0.5),
    ("score", 0.01),
    ("keypoints", 0.3),
    ("focal_px", 5.0),
    ("tilt_rad", 1e-3),
    ("height_m", 0.03),
    ("x_m", 0.1),
    ("y_m", 0.1),
    ("heading_rad", 0.02),
];

fn chain() -> Value {
    let clip = root().join("tests/data/lot.mp4");
    let mut input =
        open(&clip, &DecodeOptions { max_frames: Some(FRAMES), ..DecodeOptions::default() }).unwrap();
    let mut pictures = Vec::new();
    while let Some(frame) = input.next_frame().unwrap() {
        // Each frame has a checksum (FNV-1a), as in the tests of FFmpeg (FATE).
        let sum = frame.image.as_raw().iter().fold(0xcbf2_9ce4_8422_2325_u64, |sum, byte| {
            (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
        });
        pictures.push(json!({"time_s": frame.stamp.time_s(), "sum": format!("{sum:016x}")}));
    }
    let out = tempfile::tempdir().unwrap();
    let set = ["--set", "decode.max_frames=3", "--set", "infer.provider=cpu", "--frames"];
    roadplane().arg("run").arg(&clip).args(set).arg("--out").arg(out.path()).assert().code(0);
    let result = out.path().join("lot");
    let only = |value: &Value, names: &[&str]| -> Value {
        names
            .iter()
            .map(|name| ((*name).to_owned(), value[*name].clone()))
            .collect::<serde_json::Map<_, _>>()
            .into()
    };
    let cars = |frame: &Value| {
        let cars = frame["cars"].as_array().unwrap();
        let car = |car: &Value| {
            let mut kept = only(car, &["bbox_px", "score", "class"]);
            let points = car["keypoints"].as_array();
            kept["keypoints"] =
                points.map(|all| all.iter().map(|p| json!([p[0], p[1]])).collect()).unwrap_or_default();
            kept
        };
        json!({"cars": cars.iter().map(car).collect::<Vec<_>>()})
    };
    let frames: Vec<Value> = json_lines(&result.join("frames.jsonl")).iter().map(cars).collect();
    let rows = json_lines(&result.join("tracks.jsonl"));
    let row = |row: &Value| only(row, &["frame", "track", "class", "x_m", "y_m", "heading_rad"]);
    json!({
        "pictures": pictures,
        "frames": frames,
        "camera": only(&json(&result.join("camera.json")), &["focal_px", "tilt_rad", "height_m", "status"]),
        "tracks": rows.iter().map(row).collect::<Vec<_>>(),
    })
}

/// Adds each difference that exceeds its tolerance to `found`. `field` is the name of the innermost field, and `path`
/// is the full path to it.
fn differences(kept: &Value, now: &Value, field: &str, path: &str, found: &mut Vec<String>) {
    match (kept, now) {
        (Value::Object(a), Value::Object(b)) if a.keys().eq(b.keys()) => {
            for (name, value) in a {
                differences(value, &b[name], name, &format!("{path}.{name}"), found);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                differences(a, b, field, &format!("{path}[{i}]"), found);
            }
        }
        (Value::Number(a), Value::Number(b)) => {
            let allowed =
                TOLERANCES.iter().find(|(name, _)| *name == field).map_or(0.0, |(_, allowed)| *allowed);
            let off = (a.as_f64().unwrap() - b.as_f64().unwrap()).abs();
            if off > allowed {
                found.push(format!("{path}: {b}, kept is {a}"));
            }
        }
        _ if kept == now => {}
        _ => found.push(format!("{path}: another kind or number of values")),
    }
}

#[test]
fn the_output_of_each_stage_is_unchanged() {
    let path: PathBuf = root().join("tests/data/golden_chain.json");
    let now = chain();
    if std::env::var_os("ROADPLANE_GOLDEN").is_some() {
        fs::write(&path, format!("{now}\n")).unwrap();
        return;
    }
    let mut found = Vec::new();
    differences(&json(&path), &now, "", "chain", &mut found);
    assert!(found.is_empty(), "{} differences: {:#?}", found.len(), &found[..found.len().min(10)]);
}
