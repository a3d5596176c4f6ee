//! The scene's vertical lines as a witness for the focal length, from a clip to its camera.

use crate::common::{json, json_lines, number, roadplane, root};

#[test]
fn lines_of_the_scene_speak_of_the_focal_length() {
    let out = tempfile::tempdir().unwrap();
    let run = |name: &str, arguments: &[&str]| {
        let mut command = roadplane();
        command.arg("run").arg(root().join("tests/data/lot.mp4")).arg("--out").arg(out.path().join(name));
        command.args(["--frames", "--set", "decode.stride=3"]).args(arguments).assert().code(0);
        out.path().join(name).join("lot")
    };
    let heard = run("heard", &[]);
    let told = json(&heard.join("summary.json"))["scene_lines"].clone();
    assert!(number(&told[0]["upright"]) >= 10.0 && number(&told[0]["gain"]) > 4.6, "{told}");
    assert!(std::fs::read_to_string(heard.join("report.html")).unwrap().contains("scene lines"));
    let camera = json(&heard.join("camera.json"));
    let truth = json(&root().join("tests/data/lot.truth.json"));
    let off = (number(&camera["focal_px"]) / number(&truth["camera"]["focal_px"])).ln();
    let sd = number(&camera["focal_sd_px"]) / number(&camera["focal_px"]);
    assert!(off.abs() < 0.12 && off.abs() < 2.5 * sd, "focal length off by {off}, sd {sd}");

    // They stand in the frames' records: the same camera without any picture.
    let solved = out.path().join("poses.jsonl");
    roadplane().arg("solve").arg(heard.join("frames.jsonl")).arg("--out").arg(&solved).assert().code(0);
    let again = json(&out.path().join("camera.json"));
    assert_eq!(again["focal_px"], camera["focal_px"]);
    assert_eq!(again["covariance"], camera["covariance"]);

    let silent = run("silent", &["--set", "solve.use_verticals=false"]);
    assert!(json(&silent.join("summary.json")).get("scene_lines").is_none());
    assert!(json_lines(&silent.join("frames.jsonl")).iter().all(|frame| frame.get("scene_lines").is_none()));
    assert_ne!(json(&silent.join("camera.json"))["focal_px"], camera["focal_px"]);
}
