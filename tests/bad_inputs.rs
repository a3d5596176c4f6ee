//! Tests bad input: each program run ends with a clear error and the right exit code, and leaves no unfinished files.

use std::fs;
use std::path::Path;

use crate::common::{names, roadplane, root};

/// Runs an input that the program must reject with this exit code. Returns the messages of the program.
fn refused(input: &Path, code: i32, arguments: &[&str]) -> String {
    let out = tempfile::tempdir().unwrap();
    let assert =
        roadplane().arg("run").arg(input).arg("--out").arg(out.path()).args(arguments).assert().code(code);
    let left: Vec<String> = names(out.path()).into_iter().filter(|name| !name.contains("lock")).collect();
    assert!(left.is_empty(), "left behind: {left:?}");
    let said = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(!said.contains("panicked"), "{said}");
    said
}

#[test]
fn inputs_that_are_no_video_are_refused_by_their_content() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        path
    };
    assert!(refused(&file("empty.mp4", b""), 3, &[]).contains("empty"));
    refused(&file("text.mp4", b"this is no video, whatever its name says\n"), 3, &[]);
    refused(&file("list.mp4", b"ffconcat version 1.0\nfile /etc/passwd\n"), 3, &[]);
    let said = refused(&folder.path().join("absent.mp4"), 2, &[]);
    assert!(said.contains("No such file") && said.contains("absent.mp4"), "{said}");
    let no_images = folder.path().join("folder");
    fs::create_dir(&no_images).unwrap();
    fs::write(no_images.join("notes.txt"), "no image").unwrap();
    refused(&no_images, 3, &[]);
}

#[test]
fn a_truncated_mp4_is_refused_or_read_as_far_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    let whole = fs::read(root().join("tests/data/lot.mp4")).unwrap();
    let cut = folder.path().join("cut.mp4");
    fs::write(&cut, &whole[..whole.len() / 10]).unwrap();
    let out = folder.path().join("out");
    // The second run may find a finished result. Its exit code is the same, because the input is damaged.
    for _ in 0..2 {
        let run = roadplane()
            .arg("run")
            .arg(&cut)
            .arg("--out")
            .arg(&out)
            .args(["--resume", "--set", "decode.max_frames=1"])
            .assert();
        run.code(3);
    }
    let half_written = names(&out).into_iter().any(|name| name.ends_with(".partial"));
    assert!(!half_written);
}

#[test]
fn wrong_configurations_are_named() {
    let clip = root().join("tests/data/lot.mp4");
    assert!(refused(&clip, 2, &["--set", "detect.min_scroe=0.1"]).contains("min_scroe"));
    assert!(refused(&clip, 2, &["--set", "solve.outlier_sd=-3"]).contains("1 to 100"));
    assert!(refused(&clip, 2, &["--focal-px", "-5"]).contains("--focal-px"));
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("c.toml");
    fs::write(&config, "[detect]\nunknown = 1\n").unwrap();
    let said = refused(&clip, 2, &["--config", config.to_str().unwrap()]);
    assert!(said.contains("unknown") && said.contains("line 2"), "{said}");
}

#[test]
fn a_model_with_one_flipped_byte_is_refused() {
    let models = tempfile::tempdir().unwrap();
    for name in names(&root().join("models")) {
        fs::copy(root().join("models").join(&name), models.path().join(&name)).unwrap();
    }
    // Both nets are damaged, because the processor determines which of them runs.
    for net in ["hourglass.onnx", "hourglass.int8.onnx"].map(|name| models.path().join(name)) {
        let mut bytes = fs::read(&net).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&net, bytes).unwrap();
    }
    let setting = format!("models.folder={}", models.path().display());
    let said = refused(&root().join("tests/data/lot.mp4"), 4, &["--set", &setting]);
    assert!(said.contains("sha256"), "{said}");
}

#[test]
fn a_folder_in_use_is_refused_at_once() {
    let out = tempfile::tempdir().unwrap();
    let _lock = roadplane_pipeline::FolderLock::acquire(out.path()).unwrap();
    let clip = root().join("tests/data/lot.mp4");
    roadplane().arg("run").arg(clip).arg("--out").arg(out.path()).assert().code(11);
}

#[test]
fn boxes_that_no_frame_takes_are_not_lost_in_silence() {
    let folder = tempfile::tempdir().unwrap();
    let clip = root().join("tests/data/lot.mp4");
    let boxes = folder.path().join("boxes.jsonl");
    let line = |frame: u64| {
        let car = r#"{"bbox_px":[10,10,90,60],"score":0.9,"class":"car"}"#;
        let size = r#""image_size_px":[640,360]"#;
        format!("{{\"frame\":{frame},\"time_s\":{},{size},\"cars\":[{car}]}}\n", frame as f64 / 10.0)
    };
    let keypoints = |lines: String| {
        fs::write(&boxes, lines).unwrap();
        let mut command = roadplane();
        command.args(["stage", "keypoints"]).arg(&clip).arg("--boxes").arg(&boxes);
        command.args(["--set", "decode.max_frames=2", "--out"]).arg(folder.path().join("o.jsonl"));
        command.assert()
    };
    let assert = keypoints(line(1) + &line(0)).code(3);
    let said = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(said.contains("frame 0 comes after frame 1: sort the lines by `frame`"), "{said}");
    let assert = keypoints(line(0) + &line(1) + &line(1)).code(3);
    let said = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(said.contains("frame 1 has two lines"), "{said}");
    assert!(!folder.path().join("o.jsonl").exists());
    let assert = keypoints(line(0) + &line(1) + &line(70) + &line(71)).code(0);
    let said = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(said.contains("2 boxes belong to frames that were not read"), "{said}");
}

#[test]
fn a_missing_file_is_an_error_of_the_command_line() {
    let out = tempfile::tempdir().unwrap();
    let clip = root().join("tests/data/lot.mp4");
    let (absent, clip, out) = ("absent.file", clip.to_str().unwrap(), out.path().join("o.jsonl"));
    let out = out.to_str().unwrap();
    for command in [
        vec!["stage", "detect", absent, "--out", out],
        vec!["stage", "keypoints", clip, "--boxes", absent, "--out", out],
        vec!["stage", "solve", absent, "--out", out],
        vec!["stage", "track", absent, "--out", out],
        // The names of older versions still work.
        vec!["detect", absent, "--out", out],
        vec!["keypoints", clip, "--boxes", absent, "--out", out],
        vec!["solve", absent, "--out", out],
        vec!["track", absent, "--out", out],
        vec!["run", clip, "--known", absent, "--out", out],
        vec!["render", clip, "--run", absent],
        vec!["plan", absent],
    ] {
        let assert = roadplane().args(&command).assert().code(2);
        let said = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
        assert!(said.contains(absent), "{command:?}: {said}");
    }
}

#[test]
fn errors_have_no_debug_output() {
    let folder = tempfile::tempdir().unwrap();
    let clip = root().join("tests/data/lot.mp4");
    let said = refused(&clip, 2, &["--set", "decode.start_s=1000"]);
    assert!(
        said.contains("start 1000 s and stride 1 leave out all frames") && !said.contains("None"),
        "{said}"
    );
    let table = folder.path().join("t.csv");
    fs::write(&table, "time_s,track,x_m,y_m\n0,1,2.0\n").unwrap();
    let out = folder.path().join("labels.csv");
    let assert = roadplane().args(["stage", "activity"]).arg(&table).arg("--out").arg(&out).assert().code(3);
    let said = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(said.contains("line: 2") && !said.contains("Some("), "{said}");
}
