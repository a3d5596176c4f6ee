//! Runs the demo clip of the repository, and compares the result with the truth.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use crate::common::{first_row, json, json_lines, lab, names, number, roadplane, root};
use serde_json::Value;

#[test]
fn the_demo_clip_is_solved() {
    let out = tempfile::tempdir().unwrap();
    let clip = root().join("tests/data/lot.mp4");
    let run = |arguments: &[&str]| {
        let mut command = roadplane();
        command.arg("run").arg(&clip).arg("--out").arg(out.path()).args(["--set", "decode.stride=3"]);
        command.args(arguments).assert()
    };
    run(&[]).code(0);
    let result = out.path().join("lot");
    let files = names(&result);
    for file in [
        "camera.json",
        "poses.jsonl",
        "activities.jsonl",
        "report.html",
        "summary.json",
        "tracks.csv",
        "tracks.jsonl",
        "tracks.parquet",
    ] {
        assert!(files.iter().any(|name| name == file), "{file} of {files:?}");
    }

    let truth = json(&root().join("tests/data/lot.truth.json"));
    let camera = json(&result.join("camera.json"));
    assert_eq!(camera["status"], "estimated");
    let focal = number(&camera["focal_px"]) / number(&truth["camera"]["focal_px"]);
    assert!((0.8..1.25).contains(&focal), "focal {focal} of the truth");
    let tilt = number(&camera["tilt_rad"]) - number(&truth["camera"]["tilt_rad"]);
    assert!(tilt.abs() < 0.07, "tilt off by {tilt} rad");
    let height = number(&camera["height_m"]) / number(&truth["camera"]["height_m"]);
    assert!((0.85..1.2).contains(&height), "height {height} of the truth");

    // Every well visible true car must have a track near it, with the same heading.
    let mut of_frame: BTreeMap<u64, Vec<Value>> = BTreeMap::new();
    for row in json_lines(&result.join("tracks.jsonl")) {
        of_frame.entry(row["frame"].as_u64().unwrap()).or_default().push(row);
    }
    let (mut cars, mut found, mut turned) = (0, 0, 0);
    let (mut driving, mut followed) = (0, 0);
    for frame in truth["frames"].as_array().unwrap() {
        let Some(rows) = of_frame.get(&frame["frame"].as_u64().unwrap()) else { continue };
        for car in frame["cars"].as_array().unwrap() {
            let motion = &car["world_from_car"];
            if number(&car["visible_share"]) < 0.8 {
                continue;
            }
            cars += 1;
            let (x, y) = (number(&motion[0][3]), number(&motion[1][3]));
            let heading = number(&motion[1][0]).atan2(number(&motion[0][0]));
            let near = rows.iter().find(|row| {
                let (dx, dy) = (number(&row["x_m"]) - x, number(&row["y_m"]) - y);
                dx.hypot(dy) < 0.08 * y.hypot(x)
            });
            let speed = number(&car["speed_mps"]);
            driving += usize::from(speed > 1.0);
            if let Some(row) = near {
                found += 1;
                let speed_ratio = number(&row["speed_mps"]) / speed;
                followed += usize::from(speed > 1.0 && (0.85..1.15).contains(&speed_ratio));
                let off = (number(&row["heading_rad"]) - heading + 3.0 * PI).rem_euclid(2.0 * PI) - PI;
                turned += usize::from(off.abs() > 0.35);
            }
        }
    }
    assert!(cars > 50, "{cars}");
    assert!(f64::from(found) >= 0.8 * f64::from(cars), "{found} of {cars} cars found");
    assert!(turned * 10 <= cars as usize, "{turned} of {cars} cars turned");
    assert!(driving > 20 && followed * 4 >= driving * 3, "{followed} of {driving} driving cars followed");

    let summary = json(&result.join("summary.json"));
    assert_eq!(summary["counts"]["frames_lost"], 0);

    // The tables of `roadplane-lab eval run` must agree with these numbers.
    let tables = out.path().join("tables");
    let mut eval = lab();
    eval.args(["eval", "run"]).arg(&result).arg("--out").arg(&tables);
    eval.arg("--truth").arg(root().join("tests/data/lot.truth.json")).assert().code(0);
    let table = |name: &str| first_row(&tables.join(name));
    let camera = table("01-camera.csv");
    assert!((camera["estimate"] / camera["truth"] - focal).abs() < 1e-6, "{camera:?}");
    let tracks = table("02-tracks-on-the-ground.csv");
    assert!(tracks["HOTA, %"] > 70.0 && tracks["MOTA, %"] > 88.0, "{tracks:?}");
    assert_eq!(tracks["switches"], 0.0, "{tracks:?}");
    let motion = table("05-motion.csv");
    assert!(motion["found, %"] > 80.0 && motion["heading, median °"] < 5.0, "{motion:?}");
    assert!(motion["jitter, median m"] < 0.05, "parked cars do not move: {motion:?}");
    let poses = table("06-poses-add.csv");
    assert!(poses["cars"] > 100.0 && poses["0.8 d, %"] > 80.0, "{poses:?}");
    assert!(table("07-poses-viewpoint.csv")["0.14 rad, %"] > 75.0);
    assert!(table("08-boxes-of-cars-that-got-a.csv")["AP50, %"] > 75.0);
    let page = std::fs::read_to_string(tables.join("report.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 3);

    // A second run must give the same bytes. The program replaces an existing result only on request.
    run(&[]).code(2);
    let first = std::fs::read(result.join("tracks.csv")).unwrap();
    run(&["--overwrite"]).code(0);
    assert_eq!(first, std::fs::read(result.join("tracks.csv")).unwrap());
    run(&["--resume"]).code(0);
}

#[test]
fn stages_alone_give_the_documented_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let clip = root().join("tests/data/lot.mp4");
    let few = ["--set", "decode.max_frames=2"];
    roadplane()
        .args(["stage", "detect"])
        .arg(&clip)
        .arg("--out")
        .arg(at("b.jsonl"))
        .args(few)
        .assert()
        .code(0);
    roadplane()
        .args([
            "stage".as_ref(),
            "keypoints".as_ref(),
            clip.as_os_str(),
            "--boxes".as_ref(),
            at("b.jsonl").as_os_str(),
        ])
        .arg("--out")
        .arg(at("k.jsonl"))
        .args(few)
        .assert()
        .code(0);
    let frames = json_lines(&at("k.jsonl"));
    assert_eq!(frames.len(), 2);
    assert_eq!(frames[0]["cars"][0]["keypoints"].as_array().unwrap().len(), 36);
    roadplane().args(["stage", "solve"]).arg(at("k.jsonl")).arg("--out").arg(at("p.jsonl")).assert().code(0);
    assert!(!json_lines(&at("p.jsonl")).is_empty());
    assert!(number(&json(&at("camera.json"))["focal_px"]) > 0.0);
    let free = || {
        let mut command = roadplane();
        command.args(["stage", "solve"]).arg(at("k.jsonl")).arg("--out").arg(at("free/p.jsonl"));
        command.args(["--no-plane", "--focal-px", "1360", "--lens", "-0.1,0"]).assert()
    };
    free().code(1);
    std::fs::create_dir(at("free")).unwrap();
    free().code(0);
    assert!(!json_lines(&at("free/p.jsonl")).is_empty());
    let camera = json(&at("free/camera.json"));
    assert!((number(&camera["focal_px"]) - 1360.0).abs() < 1e-6);
    assert!(number(&camera["lens"]["bend"]) < -0.01, "the given lens counts, too");
    std::fs::create_dir(at("paper")).unwrap();
    let mut command = roadplane();
    command
        .args(["stage", "solve"])
        .arg(at("k.jsonl"))
        .args(["--method", "paper", "--out"])
        .arg(at("paper/p.jsonl"));
    command.assert().code(0);
    let poses = json_lines(&at("paper/p.jsonl"));
    assert!(poses.len() > 10 && poses.iter().all(|pose| number(&pose["world_from_car"][2][3]).abs() < 0.5));
    let focal_px = number(&json(&at("paper/camera.json"))["focal_px"]);
    assert!((focal_px / 1360.0).ln().abs() < 0.4, "{focal_px}");
    let broken = at("broken.jsonl");
    std::fs::write(&broken, "{\"frame\": 0}\n").unwrap();
    let assert =
        roadplane().args(["stage", "solve"]).arg(&broken).arg("--out").arg(at("q.jsonl")).assert().code(3);
    assert!(String::from_utf8_lossy(&assert.get_output().stderr).contains("line 1"));
    assert!(!at("q.jsonl").exists());
}

#[test]
fn doctor_finds_everything() {
    roadplane().arg("doctor").assert().code(0);
}
