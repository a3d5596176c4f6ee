//! Tests the estimates of focal length and lens distortion from lines of the scene, for whole runs.

use std::path::Path;

use nalgebra::Vector2;
use roadplane_base::{ImageSize, Lens};
use serde_json::Value;

use crate::common::{json, json_lines, number, roadplane, root};

#[test]
fn lines_of_the_scene_determine_the_focal_length() {
    let out = tempfile::tempdir().unwrap();
    let run = |name: &str, arguments: &[&str]| {
        let mut command = roadplane();
        command.arg("run").arg(root().join("tests/data/lot.mp4")).arg("--out").arg(out.path().join(name));
        command.args(["--frames", "--set", "decode.stride=3"]).args(arguments).assert().code(0);
        out.path().join(name).join("lot")
    };
    let with_lines = run("with", &[]);
    let lines = json(&with_lines.join("summary.json"))["scene_lines"].clone();
    assert!(number(&lines[0]["upright"]) >= 10.0 && number(&lines[0]["gain"]) > 4.6, "{lines}");
    assert!(std::fs::read_to_string(with_lines.join("report.html")).unwrap().contains("scene lines"));
    let camera = json(&with_lines.join("camera.json"));
    let truth = json(&root().join("tests/data/lot.truth.json"));
    let off = (number(&camera["focal_px"]) / number(&truth["camera"]["focal_px"])).ln();
    let sd = number(&camera["focal_sd_px"]) / number(&camera["focal_px"]);
    assert!(off.abs() < 0.12 && off.abs() < 2.5 * sd, "focal length off by {off}, sd {sd}");

    // The file frames.jsonl contains the lines. So it gives the same camera without any picture.
    let solved = out.path().join("poses.jsonl");
    let frames = with_lines.join("frames.jsonl");
    roadplane().args(["stage", "solve"]).arg(frames).arg("--out").arg(&solved).assert().code(0);
    let again = json(&out.path().join("camera.json"));
    assert_eq!(again["focal_px"], camera["focal_px"]);
    assert_eq!(again["covariance"], camera["covariance"]);

    seen_through_a_lens(&with_lines, number(&truth["camera"]["focal_px"]));

    let without = run("without", &["--set", "solve.use_verticals=false", "--set", "solve.use_lens=false"]);
    assert!(json(&without.join("summary.json")).get("scene_lines").is_none());
    assert!(json_lines(&without.join("frames.jsonl")).iter().all(|frame| frame.get("scene_lines").is_none()));
    assert_ne!(json(&without.join("camera.json"))["focal_px"], camera["focal_px"]);
}

/// Distorts the boxes and keypoints of a run as a lens would. Adds curves that are straight edges in the scene, and
/// solves the run again.
///
/// With its lens model, the solver must estimate the distortion, and the focal length must be as good as without
/// distortion. Without its lens model, the focal length must differ.
fn seen_through_a_lens(run: &Path, true_focal_px: f64) {
    const DISTORTION: f64 = -0.13;
    let folder = tempfile::tempdir().unwrap();
    let mut frames = json_lines(&run.join("frames.jsonl"));
    let size: ImageSize = serde_json::from_value(frames[0]["image_size_px"].clone()).unwrap();
    let lens = Lens::with_distortion(DISTORTION, size);
    let distorted =
        |x: f64, y: f64| lens.distorted(&(Vector2::new(x, y) - size.centre_px())) + size.centre_px();
    let (width, height) = (f64::from(size.width), f64::from(size.height));
    let edge = |i: i32| {
        let angle = f64::from(i) * 0.7;
        let middle = Vector2::new(
            width * (0.5 + 0.3 * (f64::from(i) * 2.1).cos()),
            height * (0.5 + 0.3 * (f64::from(i) * 1.3).sin()),
        );
        let along = Vector2::new(angle.cos(), angle.sin()) * 0.3 * height;
        let points = [middle - along, middle, middle + along].map(|p| distorted(p.x, p.y));
        let mut numbers: Vec<f64> = points.iter().flat_map(|p| [p.x, p.y]).collect();
        numbers.push(0.5);
        numbers
    };
    for frame in &mut frames {
        for edges in ["scene_lines", "scene_curves"] {
            frame.as_object_mut().unwrap().remove(edges);
        }
        for car in frame["cars"].as_array_mut().unwrap() {
            let corners: Vec<f64> = car["bbox_px"].as_array().unwrap().iter().map(number).collect();
            let [low, high] = [distorted(corners[0], corners[1]), distorted(corners[2], corners[3])];
            car["bbox_px"] = serde_json::json!([low.x, low.y, high.x, high.y]);
            for point in
                car["keypoints"].as_array_mut().into_iter().flatten().filter(|point| point.is_array())
            {
                let moved = distorted(number(&point[0]), number(&point[1]));
                (point[0], point[1]) = (moved.x.into(), moved.y.into());
            }
        }
    }
    frames[0]["scene_curves"] = (0..40).map(edge).collect();
    let path = folder.path().join("frames.jsonl");
    let lines: Vec<String> = frames.iter().map(ToString::to_string).collect();
    std::fs::write(&path, lines.join("\n")).unwrap();
    let camera = |arguments: &[&str]| {
        let mut solve = roadplane();
        solve
            .args(["stage", "solve"])
            .arg(&path)
            .arg("--out")
            .arg(folder.path().join("poses.jsonl"))
            .args(arguments);
        solve.assert().code(0);
        json(&folder.path().join("camera.json"))
    };
    let off = |camera: &Value| (number(&camera["focal_px"]) / true_focal_px).ln();
    let found = camera(&[]);
    assert!(
        (number(&found["lens"]["bend"]) - DISTORTION).abs() < 3.0 * number(&found["lens"]["bend_sd"]),
        "{found}"
    );
    let sd = number(&found["focal_sd_px"]) / number(&found["focal_px"]);
    assert!(off(&found).abs() < 0.15 && off(&found).abs() < 2.5 * sd, "{} {sd}", off(&found));
    let straight = camera(&["--set", "solve.use_lens=false"]);
    assert!(straight["lens"].is_null() && straight["focal_px"] != found["focal_px"]);
}
