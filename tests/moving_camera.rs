//! A camera that moves: the frames in which vehicles cannot be followed are counted and reported.

use std::path::Path;

use crate::common::{json, roadplane, root};

/// Writes the pictures of a camera that pans over a still picture by `px_per_frame`.
fn pan(folder: &Path, frames: u32, px_per_frame: f64) {
    let still = image::open(root().join("docs/book/images/still.jpg")).unwrap();
    let (width, height) = (still.width() * 2 / 3, still.height() * 2 / 3);
    for frame in 0..frames {
        let left = (f64::from(frame) * px_per_frame).round() as u32;
        let part = still.crop_imm(left, still.height() / 4, width, height);
        part.save(folder.join(format!("{frame:04}.png"))).unwrap();
    }
}

#[test]
fn a_panning_camera_is_reported_as_partly_followed() {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("pan");
    std::fs::create_dir(&clip).unwrap();
    pan(&clip, 60, 6.0);
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
    assert!(text.contains("WARN the camera moved: vehicles were not followed in"), "{text}");
    let summary = json(&out.join("pan/summary.json"));
    assert_eq!((&summary["status"], &summary["exit_code"]), (&"partly_followed".into(), &3.into()));
    let frames = summary["counts"]["frames_not_followed"].as_u64().unwrap();
    assert!(frames > 30, "{frames}");
    assert!(summary["watch"]["not_followed_s"].as_f64().unwrap() > 2.0);
    assert!(summary["watch"]["not_followed_share"].as_f64().unwrap() > 0.5);
    let report = std::fs::read_to_string(out.join("pan/report.html")).unwrap();
    assert!(report.contains(&format!("Vehicles were not followed in {frames} frames")));
    run(&["--resume"]);
}
