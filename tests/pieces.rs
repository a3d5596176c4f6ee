//! Tests the processing of a long clip in pieces. The joined result must have the same bytes as the result of the whole
//! clip.

use std::path::Path;

use crate::common::{json, json_lines, names, played, process, roadplane, root};
use assert_cmd::assert::Assert;
use image::imageops::{FilterType, resize};
use roadplane_decode::{DecodeOptions, open};
use roadplane_view::VideoSink;

/// Frames per second of the clip. The value is small to keep the test short.
const FPS: f64 = 2.0;

/// Writes a clip of a little more than two minutes, which plays the demo clip forwards and backwards.
fn long_clip(path: &Path) {
    let mut input = open(&root().join("tests/data/lot.mp4"), &DecodeOptions::default()).unwrap();
    let mut pictures = Vec::new();
    while let Some(frame) = input.next_frame().unwrap() {
        pictures.push(resize(&frame.image, 640, 360, FilterType::Triangle));
    }
    let last = pictures.len() - 1;
    let mut video = VideoSink::create(path, 640, 360, FPS).unwrap();
    for i in 0..(128.0 * FPS) as usize {
        let at = i % (2 * last);
        video.write(&pictures[at.min(2 * last - at)]).unwrap();
    }
    video.finish().unwrap();
}

/// Asserts that a command ends with exit code 2, and that its message contains `word`.
fn refused(command: Assert, word: &str) {
    let said = String::from_utf8(command.code(2).get_output().stderr.clone()).unwrap();
    assert!(said.contains(word), "{said}");
}

#[test]
fn pieces_joined_are_the_whole_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("night.mp4");
    long_clip(&clip);
    let at = |name: &str| folder.path().join(name);
    let run = |arguments: &[&str], out: &str| {
        let mut command = roadplane();
        command.arg("run").arg(&clip).args(arguments).arg("--out").arg(at(out)).assert()
    };
    run(&["--frames"], "whole").code(0);

    let planned = roadplane().arg("plan").arg(&clip).args(["--piece-s", "60"]).assert().code(0);
    std::fs::write(at("plan.jsonl"), &planned.get_output().stdout).unwrap();
    let plan = json_lines(&at("plan.jsonl"));
    let text = |line: &serde_json::Value, key: &str| line[key].as_str().unwrap().to_owned();
    let pieces: Vec<String> = plan.iter().map(|line| text(line, "piece")).collect();
    assert_eq!(pieces, ["0-60", "60-120", "120-"]);
    for line in plan.iter().rev() {
        run(&["--piece", &text(line, "piece")], "pieces").code(0);
    }
    let folders: Vec<_> = plan.iter().map(|line| at("pieces").join(text(line, "folder"))).collect();
    assert_eq!(names(&at("pieces")).len(), 3 + 1, "three pieces and the lock");

    let join = |folders: &[std::path::PathBuf], arguments: &[&str]| {
        roadplane().arg("join").args(folders).args(arguments).arg("--out").arg(at("joined")).assert()
    };
    refused(join(&folders[1..], &[]), "before 60 s is missing");
    refused(join(&folders[..2], &[]), "after this one are missing");
    refused(join(&folders, &["--set", "track.min_observed=9"]), "another configuration");
    let [first, second, third] = &folders[..] else { unreachable!() };
    let cameras = at("cameras").display().to_string();
    let stored = ["--frames", "--cameras", &cameras, "--camera-id", "night"];
    join(&[third.clone(), first.clone(), second.clone()], &stored).code(0);
    assert!(at("joined/night/evidence.json").is_file(), "the last piece shows the camera's last position");
    for file in ["frames.jsonl", "camera.json", "poses.jsonl", "tracks.csv", "activities.jsonl"] {
        let of = |out: &str| std::fs::read(at(out).join("night").join(file)).unwrap();
        assert!(!of("whole").is_empty() && of("joined") == of("whole"), "{file}");
    }
    let report = |out: &str| played(&at(out).join("night/report.html"));
    assert!(report("joined") == report("whole"), "the reports play the same");

    // A run that is stopped in its second minute continues with the results of the first minute.
    let spool = at("stopped").join(".night.partial/frames.jsonl");
    let lines = || std::fs::read(&spool).map_or(0, |bytes| bytes.iter().filter(|b| **b == b'\n').count());
    let mut stopped = process().arg("run").arg(&clip).arg("--out").arg(at("stopped")).spawn().unwrap();
    while lines() < 150 {
        assert_eq!(stopped.try_wait().unwrap(), None, "too fast to be stopped");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let kill = std::process::Command::new("kill").arg(stopped.id().to_string()).status().unwrap();
    assert!(kill.success());
    assert_eq!(stopped.wait().unwrap().code(), Some(143));
    run(&["--resume"], "stopped").code(0);
    assert!(report("stopped") == report("whole"), "the report plays the same");

    let summary = |out: &str| json(&at(out).join("night/summary.json"));
    for key in ["counts", "watch", "warnings", "input", "models", "config_sha256", "status"] {
        assert_eq!(summary("joined")[key], summary("whole")[key], "{key}");
    }

    refused(run(&["--piece", "30-60"], "pieces"), "multiples of 60 s");
    refused(run(&["--piece", "60-120"], "pieces"), "there is a result already");
    run(&["--piece", "60-120", "--resume"], "pieces").code(0);
}
