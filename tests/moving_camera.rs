//! A camera that moves: vehicles are followed through a pan, and a camera that cannot be followed is reported.

use std::path::Path;

use image::imageops::{FilterType, resize};
use image::{DynamicImage, GenericImageView as _};

use crate::common::{json, roadplane, root};

/// Writes pictures of a still scene. `part` returns the left edge, the top edge, the width and the height of the part
/// that is shown in a frame, as shares of the scene's width. Each picture has 853 × 480 px.
fn film(folder: &Path, frames: u32, part: impl Fn(f64) -> [f64; 4]) {
    std::fs::create_dir(folder).unwrap();
    let still: DynamicImage = image::open(root().join("docs/book/images/still.jpg")).unwrap();
    let width = f64::from(still.width());
    for frame in 0..frames {
        let [left, top, across, down] = part(f64::from(frame)).map(|share| (share * width).round() as u32);
        let shown = still.view(left, top, across, down).to_image();
        resize(&shown, 853, 480, FilterType::Triangle).save(folder.join(format!("{frame:04}.png"))).unwrap();
    }
}

#[test]
fn vehicles_are_followed_through_a_pan() {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("pan");
    film(&clip, 45, |frame| [0.004 * frame, 0.1, 0.66, 0.37]);
    let out = folder.path().join("out");
    let run = roadplane()
        .arg("run")
        .arg(&clip)
        .arg("--out")
        .arg(&out)
        .args(["--set", "decode.image_fps=15", "--frames"])
        .assert();
    let text = String::from_utf8(run.code(0).get_output().stderr.clone()).unwrap();
    assert!(!text.contains("not followed"), "{text}");
    let summary = json(&out.join("pan/summary.json"));
    assert_eq!(summary["counts"]["frames_not_followed"], 0);
    let camera = json(&out.join("pan/camera.json"));
    assert_eq!(camera["segments"].as_array().unwrap().len(), 1);
    let motion = camera["motion"].as_array().unwrap();
    assert!(motion.len() >= 43, "{}", motion.len());
    // The picture moves to the left by 0.004 of the scene's width per frame.
    let last = &motion[motion.len() - 1];
    let shift = last["picture_from_world"][2].as_f64().unwrap();
    let truth = -0.004 / 0.66 * 853.0 * last["frame"].as_f64().unwrap();
    assert!((shift - truth).abs() < 3.0, "{shift} {truth}");
    let rows = std::fs::read_to_string(out.join("pan/tracks.jsonl")).unwrap();
    let of = |key: &str| -> Vec<f64> {
        let rows = rows.lines().map(|row| serde_json::from_str::<serde_json::Value>(row).unwrap());
        rows.map(|row| row[key].as_f64().unwrap()).collect()
    };
    assert!(of("frame").iter().any(|frame| *frame >= 43.0), "no row at the end of the pan");
}

#[test]
fn a_camera_that_no_turn_explains_is_reported_as_partly_followed() {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("carried");
    // The picture grows in one direction alone, as no turn and no zoom can make it.
    film(&clip, 60, |frame| [0.0, 0.1, 0.5 + 0.004 * frame, 0.37]);
    let out = folder.path().join("out");
    let run = |resume: &[&str]| {
        roadplane()
            .arg("run")
            .arg(&clip)
            .arg("--out")
            .arg(&out)
            .args(["--set", "decode.image_fps=15"])
            .args(resume)
            .assert()
            .code(3)
    };
    let text = String::from_utf8(run(&[]).get_output().stderr.clone()).unwrap();
    assert!(text.contains("the camera was carried along: vehicles were not followed in"), "{text}");
    let summary = json(&out.join("carried/summary.json"));
    assert_eq!((&summary["status"], &summary["exit_code"]), (&"partly_followed".into(), &3.into()));
    let frames = summary["counts"]["frames_not_followed"].as_u64().unwrap();
    assert!(frames > 30, "{frames}");
    assert_eq!(summary["watch"]["not_followed"][0]["reason"], "travelling");
    assert!(summary["watch"]["not_followed_s"].as_f64().unwrap() > 2.0);
    assert!(summary["watch"]["not_followed_share"].as_f64().unwrap() > 0.5);
    let report = std::fs::read_to_string(out.join("carried/report.html")).unwrap();
    assert!(report.contains(&format!("Vehicles were not followed in {frames} frames")));
    run(&["--resume"]);
}
