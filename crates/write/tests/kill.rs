//! A run is killed at any moment and started again. In the end its files have the same bytes as those of an undisturbed
//! run.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use roadplane_base::{FrameRecord, ImageSize};
use roadplane_write::{Existing, FolderLock, FrameSpool, OutputFolder, write_json};

const CHILD: &str = "ROADPLANE_TEST_KILL_DIR";
const FRAMES: u64 = 400;

/// Imitates a run: appends frames to the frames file, writes `summary.json` and publishes the folder.
fn run(dir: &Path) {
    let _lock = FolderLock::acquire(dir).unwrap();
    let folder = OutputFolder::begin(dir, "clip", Existing::Overwrite).unwrap();
    let (mut spool, recovered) =
        FrameSpool::open(&folder.path().join("frames.jsonl"), |record| record.frame / 16).unwrap();
    for frame in recovered.last_frame.map_or(0, |last| last + 1)..FRAMES {
        let size = ImageSize { width: 1920, height: 1080 };
        let mut record = FrameRecord::empty(frame, frame as f64 / 25.0, size);
        record.extra.insert("note".to_owned(), "x".repeat(500).into());
        spool.append(&record).unwrap();
        if frame % 16 == 0 {
            spool.sync().unwrap();
        }
    }
    spool.sync().unwrap();
    write_json(&folder.path().join("summary.json"), &serde_json::json!({"frames": FRAMES})).unwrap();
    folder.publish().unwrap();
}

#[test]
fn child() {
    if let Some(dir) = std::env::var_os(CHILD) {
        run(Path::new(&dir));
    }
}

fn start(dir: &Path) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "child"])
        .env(CHILD, dir)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn contents(dir: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(dir)
        .unwrap()
        .map(|e| e.unwrap().path())
        .map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(p).unwrap()))
        .collect();
    files.sort();
    files
}

#[test]
fn fifty_kills_change_nothing() {
    let undisturbed = tempfile::tempdir().unwrap();
    let clock = std::time::Instant::now();
    assert!(start(undisturbed.path()).wait().unwrap().success());
    let whole = clock.elapsed();
    let expected = contents(&undisturbed.path().join("clip"));
    assert_eq!(expected.len(), 2);
    let temp = tempfile::tempdir().unwrap();
    for i in 0..50u32 {
        // Five runs use the same folder. Each run resumes a killed run or replaces a finished result.
        let dir = temp.path().join((i / 5).to_string());
        let mut child = start(&dir);
        std::thread::sleep(Duration::from_secs_f64(whole.as_secs_f64() * f64::from(i * 37 % 50) / 50.0));
        child.kill().unwrap();
        child.wait().unwrap();
        if dir.join("clip").exists() {
            assert_eq!(contents(&dir.join("clip")), expected, "a published folder is complete");
        }
    }
    for i in 0..10 {
        let dir = temp.path().join(i.to_string());
        assert!(
            start(&dir).wait().unwrap().success(),
            "leftover locks and partial files do not prevent a run"
        );
        assert_eq!(contents(&dir.join("clip")), expected);
        let names: Vec<_> = contents_names(&dir);
        assert_eq!(names, [".roadplane.lock", "clip"]);
    }
}

fn contents_names(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}
