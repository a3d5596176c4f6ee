//! Tests the camera database over several nights.

use std::fs;
use std::path::Path;

use image::{Rgb, RgbImage};
use roadplane_decode::{DecodeOptions, open};
use serde_json::Value;

use crate::common::{json, names, number, roadplane, root};

/// Number of frames of each night.
const FRAMES: u64 = 10;

/// Writes frames of the demo clip as a folder of images, which stands for one night. The images show the view of a
/// camera that is turned upwards by an angle (rad).
fn night(folder: &Path, start_s: f64, turned_rad: f64) {
    let options = DecodeOptions { start_s, stride: 3, max_frames: Some(FRAMES), ..DecodeOptions::default() };
    moving_night(folder, &options, |_| turned_rad);
}

/// Writes the chosen frames of the demo clip as [`night`] does. The angle depends on the index of the frame.
fn moving_night(folder: &Path, options: &DecodeOptions, turned_rad: impl Fn(u64) -> f64) {
    fs::create_dir_all(folder).unwrap();
    let mut input = open(&root().join("tests/data/lot.mp4"), options).unwrap();
    let truth = json(&root().join("tests/data/lot.truth.json"));
    let focal_px = number(&truth["camera"]["focal_px"]);
    while let Some(frame) = input.next_frame().unwrap() {
        let image = turned(&frame.image, focal_px, turned_rad(frame.stamp.index));
        image.save(folder.join(format!("f{:04}.jpg", frame.stamp.index))).unwrap();
    }
}

/// Returns the picture of a camera that is turned upwards by an angle (rad). Pixels outside the old picture repeat its
/// border.
fn turned(image: &RgbImage, focal_px: f64, angle: f64) -> RgbImage {
    let (width, height) = image.dimensions();
    let (cx, cy) = ((f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0);
    RgbImage::from_fn(width, height, |x, y| {
        let (u, v) = ((f64::from(x) - cx) / focal_px, (f64::from(y) - cy) / focal_px);
        let (v, z) = (v * angle.cos() - angle.sin(), v * angle.sin() + angle.cos());
        let (px, py) = (cx + focal_px * u / z, cy + focal_px * v / z);
        let (px, py) = (px.clamp(0.0, f64::from(width) - 1.001), py.clamp(0.0, f64::from(height) - 1.001));
        let (left, top) = (px as u32, py as u32);
        let (a, b) = (px.fract(), py.fract());
        let pixel = |dx: u32, dy: u32| image.get_pixel(left + dx, top + dy).0;
        Rgb(std::array::from_fn(|c| {
            let row = |dy: u32| f64::from(pixel(0, dy)[c]) * (1.0 - a) + f64::from(pixel(1, dy)[c]) * a;
            (row(0) * (1.0 - b) + row(1) * b).round() as u8
        }))
    })
}

fn run(inputs: &[&Path], out: &Path, cameras: &Path) {
    run_with(&[], inputs, out, cameras);
}

/// Runs the program with additional arguments, and returns its messages.
fn run_with(arguments: &[&str], inputs: &[&Path], out: &Path, cameras: &Path) -> String {
    let mut command = roadplane();
    command.arg("run").args(arguments).args(inputs).arg("--out").arg(out).arg("--cameras").arg(cameras);
    // These tests use cars only, so lines of the scene are switched off.
    command.args(["--set", "decode.image_fps=10", "--set", "solve.use_verticals=false"]);
    let done = command.args(["--camera-id", "{}_*"]).assert().code(0);
    String::from_utf8(done.get_output().stderr.clone()).unwrap()
}

/// Returns the epochs of the camera `lot`, as printed by `roadplane cameras show`.
fn shown(cameras: &Path) -> Vec<Value> {
    let output = roadplane().args(["cameras", "show", "--json"]).arg(cameras).arg("lot").output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn a_camera_that_moves_within_its_clips_is_stored_as_the_last_pictures_show_it() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    let turn = 2.5_f64.to_radians();
    let nights = [at("lot_20260101T220000"), at("lot_20260102T220000")];
    // The camera turns after a second, and the next night begins where it stays.
    let first = DecodeOptions { max_frames: Some(34), ..DecodeOptions::default() };
    moving_night(&nights[0], &first, |frame| if frame < 10 { 0.0 } else { turn });
    night(&nights[1], 2.0, turn);
    let cameras = at("cameras");
    run(&[&nights[0]], &at("out"), &cameras);
    let said = run_with(&[], &[&nights[1]], &at("out"), &cameras);
    assert!(said.contains("the camera database has 1 clips of it"), "{said}");
    let tilt = |night: &str| number(&json(&at(&format!("out/{night}/camera.json")))["tilt_rad"]);
    let change = tilt("lot_20260101T220000") - tilt("lot_20260102T220000");
    assert!((change - turn).abs() < 0.6_f64.to_radians(), "{}°", change.to_degrees());

    // A camera that sways has one mean position in all nights.
    let swaying = at("swaying");
    let every_other = DecodeOptions { stride: 2, ..DecodeOptions::default() };
    let sway = |phase: f64| move |frame: u64| 0.007 * (0.6 * frame as f64 + phase).sin();
    for (name, phase) in [("lot_20260103T220000", 0.0), ("lot_20260104T220000", 1.6)] {
        moving_night(&at(name), &every_other, sway(phase));
        run(&[&at(name)], &at("out"), &swaying);
    }
    let epochs = shown(&swaying);
    assert_eq!(epochs.len(), 1, "{epochs:?}");
    assert_eq!(epochs[0]["clips"].as_array().unwrap().len(), 2);
}

#[test]
fn a_camera_is_stored_for_the_next_night_and_a_turn_begins_an_epoch() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    let nights = [at("lot_20260101T220000"), at("lot_20260102T220000"), at("lot_20260103T220000")];
    night(&nights[0], 0.0, 0.0);
    night(&nights[1], 2.0, 0.0);
    let turn = 2_f64.to_radians();
    night(&nights[2], 1.0, turn);
    let cameras = at("cameras");
    run(&[&nights[0]], &at("out"), &cameras);
    run(&[&nights[1]], &at("out"), &cameras);
    let epochs = shown(&cameras);
    assert_eq!(epochs.len(), 1, "{epochs:?}");
    assert_eq!(epochs[0]["clips"].as_array().unwrap().len(), 2);
    // The same cars are parked on both nights, so the second night adds no information about them.
    let first = json(&at("out/lot_20260101T220000/camera.json"));
    let second = json(&at("out/lot_20260102T220000/camera.json"));
    let sd = |camera: &Value| number(&camera["focal_sd_px"]) / number(&camera["focal_px"]);
    assert!(
        sd(&second) < 1.05 * sd(&first) && sd(&second) > 0.8 * sd(&first),
        "{} {}",
        sd(&first),
        sd(&second)
    );

    run(&[&nights[2]], &at("out"), &cameras);
    let epochs = shown(&cameras);
    assert_eq!(epochs.len(), 2, "{epochs:?}");
    assert_eq!(epochs[1]["clips"].as_array().unwrap().len(), 1);
    let third = json(&at("out/lot_20260103T220000/camera.json"));
    let tilt = |value: &Value| number(&value["tilt_rad"]);
    assert!((tilt(&third) - tilt(&epochs[1])).abs() < 1e-4, "the first clip of an epoch is alone");
    let change = tilt(&epochs[0]) - tilt(&epochs[1]);
    assert!((change - turn).abs() < 0.6_f64.to_radians(), "{}°", change.to_degrees());

    // A merge of the results, in another order, gives the same bytes in the camera database.
    let merged = at("merged");
    roadplane().args(["cameras", "merge"]).arg(at("out")).arg("--out").arg(&merged).assert().code(0);
    let contents = |folder: &Path| -> Vec<_> {
        let mut files: Vec<_> =
            fs::read_dir(folder.join("lot")).unwrap().map(|e| e.unwrap().path()).collect();
        files.sort();
        files.iter().map(|f| (f.file_name().unwrap().to_owned(), fs::read(f).unwrap())).collect()
    };
    assert_eq!(contents(&merged), contents(&cameras));

    // A run does not use the stored evidence of its own clip. So the first night uses only the second night from the
    // database. The message must appear only once, in spite of the uncertain height.
    let said = run_with(&["--height-m", "8±3"], &[&nights[0]], &at("again"), &merged);
    assert_eq!(said.matches("the camera database has").count(), 1, "{said}");
    let again = json(&at("again/lot_20260101T220000/camera.json"));
    assert!((number(&again["focal_px"]) / number(&second["focal_px"]) - 1.0).abs() < 0.02);
    assert_eq!(contents(&merged).len(), 3, "the same clip has the same evidence");

    roadplane().args(["cameras", "forget"]).arg(&merged).arg("lot").assert().code(0);
    assert!(roadplane().args(["cameras", "list"]).arg(&merged).output().unwrap().stdout.is_empty());
    roadplane().args(["cameras", "forget"]).arg(&merged).arg("lot").assert().code(2);
}

#[test]
fn a_camera_that_cannot_be_named_is_an_error_of_the_command_line() {
    let temp = tempfile::tempdir().unwrap();
    for id in ["../x", "{}_{}", ""] {
        let mut command = roadplane();
        command.args(["run", "tests/data/lot.mp4", "--camera-id", id, "--out"]).arg(temp.path().join("o"));
        command.arg("--cameras").arg(temp.path().join("c")).assert().code(2);
    }
    assert!(!temp.path().join("c").exists());
}

#[test]
fn a_clip_without_a_camera_in_its_name_does_not_use_the_database() {
    let temp = tempfile::tempdir().unwrap();
    let (out, cameras) = (temp.path().join("o"), temp.path().join("c"));
    let mut command = roadplane();
    command.args(["run", "tests/data/lot.mp4", "--set", "decode.max_frames=3", "--camera-id", "gate_{}"]);
    command.arg("--cameras").arg(&cameras).arg("--out").arg(&out).assert().code(0);
    let warnings = json(&out.join("lot/summary.json"))["warnings"].to_string();
    assert!(warnings.contains("finds no camera in the name"), "{warnings}");
    assert!(!out.join("lot/evidence.json").exists() && names(&cameras).is_empty());
}
