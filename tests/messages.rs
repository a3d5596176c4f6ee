//! Compares texts that users read with snapshots: help, errors and the log of a run.
//!
//! After an intended change, run `INSTA_UPDATE=always cargo test --release -p roadplane --test e2e messages`. Then
//! review the difference.

use std::path::Path;

use crate::common::roadplane;

/// The commands that `roadplane --help` shows.
const COMMANDS: [&str; 11] =
    ["run", "render", "distance", "cameras", "plan", "join", "export", "copy", "schemas", "stage", "doctor"];
/// Commands of older versions. They still work, but the help does not list them.
const HIDDEN: [&str; 10] =
    ["detect", "keypoints", "solve", "track", "activity", "eval", "bench", "synth", "man", "completions"];

fn help(arguments: &[&str]) -> String {
    let done = roadplane().env("COLUMNS", "100").args(arguments).arg("--help").assert().code(0);
    String::from_utf8(done.get_output().stdout.clone()).unwrap()
}

/// Runs a command that must fail with this exit code. Returns its messages without times.
fn error(arguments: &[&str], code: i32) -> String {
    let failed = roadplane().args(arguments).assert().code(code);
    without_times(&String::from_utf8(failed.get_output().stderr.clone()).unwrap())
}

/// Removes the time from each line of a log, and removes lines that depend on the processor or its load. These lines
/// show the precision of the nets, the progress, which appears after ten seconds, and stages that wait for long.
fn without_times(log: &str) -> String {
    let line = |line: &str| match line.split_once("Z ") {
        Some((time, rest)) if time.starts_with("20") => format!("{rest}\n"),
        _ => format!("{line}\n"),
    };
    let is_progress = |line: &str| line.contains(" INFO ") && line.contains(" frames/s");
    let is_waiting = |line: &str| line.contains(" has been waiting ");
    let varies = |line: &str| line.contains("nets run in") || is_progress(line) || is_waiting(line);
    log.lines().filter(|text| !varies(text)).map(line).collect()
}

#[test]
fn the_help_lists_every_command_with_an_example() {
    let text = help(&[]);
    insta::assert_snapshot!(text);
    for command in COMMANDS {
        assert!(
            text.contains(&format!("\n  {command:<9} "))
                && text.contains(&format!("    roadplane {command}"))
        );
        assert!(help(&[command]).contains("Example:\n"), "{command} has no example");
    }
    for command in HIDDEN {
        assert!(!text.contains(&format!("\n  {command} ")), "{command} is shown");
        assert!(!help(&[command]).is_empty());
    }
}

#[test]
fn the_help_of_each_command() {
    for command in COMMANDS {
        insta::assert_snapshot!(command, help(&[command]));
    }
}

#[test]
fn errors_name_the_fault_and_the_remedy() {
    let out = tempfile::tempdir().unwrap();
    let out = out.path().to_str().unwrap();
    let clip = "tests/data/lot.mp4";
    let cases: [(&str, &[&str], i32); 9] = [
        ("missing_input", &["run", "absent.mp4", "--out", out], 2),
        ("no_video", &["run", "tests/data/geometry.json", "--out", out], 3),
        ("unknown_setting", &["run", clip, "--out", out, "--set", "detect.min_scroe=0.4"], 2),
        ("setting_out_of_range", &["run", clip, "--out", out, "--set", "detect.min_score=2"], 2),
        ("wrong_constraint", &["run", clip, "--out", out, "--focal-px", "-5"], 2),
        ("unknown_format", &["export", out, "--format", "kitty", "--out", out], 2),
        ("no_run", &["distance", "absent", "1", "2"], 2),
        ("unknown_camera", &["cameras", "show", out, "gate"], 2),
        ("unknown_schema", &["schemas", "trakcs"], 2),
    ];
    for (name, arguments, code) in cases {
        insta::assert_snapshot!(name, error(arguments, code).replace(out, "OUT"));
    }
}

#[test]
fn the_log_of_a_run() {
    let out = tempfile::tempdir().unwrap();
    let (folder, clip) = (out.path().to_str().unwrap(), Path::new("tests/data/lot.mp4"));
    let done =
        roadplane().arg("run").arg(clip).args(["--out", folder, "--height-m", "20±0.1"]).assert().code(0);
    let log = without_times(&String::from_utf8(done.get_output().stderr.clone()).unwrap());
    // The precision of the nets depends on the processor. So the last digits of numbers differ between processors.
    let log = log.replace(folder, "OUT");
    let mut text: Vec<char> = log.chars().map(|c| if c.is_ascii_digit() { '0' } else { c }).collect();
    text.dedup_by(|next, last| *next == '0' && *last == '0');
    insta::assert_snapshot!(text.into_iter().collect::<String>());
}
