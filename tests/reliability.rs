//! Tests faults of machines: memory limits, disks, signals, and files that change. The scripts in `scripts/reliability`
//! make long runs with the same kinds of faults.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::{names, played, process, roadplane, root};

/// Settings that limit a run to a few frames of the demo clip.
const SHORT: [&str; 2] = ["--set", "decode.max_frames=12"];

fn clip() -> PathBuf {
    root().join("tests/data/lot.mp4")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Returns the program as a command that runs under the limits that the shell sets with `limits`.
fn limited(limits: &str) -> Command {
    let mut command = Command::new("bash");
    command.arg("-c").arg(format!("{limits}; exec \"$0\" \"$@\"")).arg(roadplane().get_program());
    command.current_dir(root()).env("ORT_DYLIB_PATH", root().join(".runtime/libonnxruntime.so"));
    command
}

/// Returns the contents of those files of a result that must be the same in all runs. Files with the time of day or the
/// speed of the run are left out.
fn contents(result: &Path) -> Vec<(String, Vec<u8>)> {
    let varies = ["summary.json", "report.html"];
    let traffic = names(&result.join("traffic")).into_iter().map(|name| format!("traffic/{name}"));
    let files =
        names(result).into_iter().filter(|name| !varies.contains(&name.as_str()) && name != "traffic");
    let files = files.chain(traffic);
    let played = ("played data".to_owned(), played(&result.join("report.html")).into_bytes());
    files.map(|name| (name.clone(), fs::read(result.join(name)).unwrap())).chain([played]).collect()
}

#[test]
fn any_limit_on_memory_gives_a_result_or_a_message() {
    let out = tempfile::tempdir().unwrap();
    for mib in [400, 500, 600, 700, 800, 900, 1000, 1100, 1200, 1300, 1400, 1600] {
        let output = limited(&format!("ulimit -v {}", mib * 1024))
            .args(["run", "--overwrite"])
            .arg(clip())
            .args(SHORT)
            .arg("--out")
            .arg(out.path())
            .output()
            .unwrap();
        let text = said(&output);
        match output.status.code() {
            Some(0) => assert!(mib >= 1000, "{mib} MiB were enough?"),
            Some(1) => assert!(text.contains("memory") && text.contains("ulimit -v"), "{mib} MiB: {text}"),
            other => panic!("{mib} MiB: {other:?} {text}"),
        }
        if mib == 1600 {
            assert_eq!(output.status.code(), Some(0), "{text}");
        }
    }
}

#[test]
fn a_run_stopped_by_a_signal_continues_where_it_was() {
    let temp = tempfile::tempdir().unwrap();
    let (whole, cut) = (temp.path().join("whole"), temp.path().join("cut"));
    let run = |out: &Path| {
        let mut run = process();
        run.arg("run").arg(clip()).arg("--out").arg(out).args(["--resume", "--set", "decode.max_frames=60"]);
        run.stderr(Stdio::piped());
        run
    };
    assert!(run(&whole).status().unwrap().success());
    for (signal, code) in [("TERM", 143), ("INT", 130)] {
        // Each run writes the file stamp.json again once it handles signals.
        let stamp = || cut.join(".lot.partial/stamp.json").metadata().and_then(|stamp| stamp.modified()).ok();
        let before = stamp();
        let mut child = run(&cut).spawn().unwrap();
        while stamp() == before {
            std::thread::sleep(Duration::from_millis(10));
        }
        std::thread::sleep(Duration::from_millis(300));
        Command::new("kill").args(["-s", signal, &child.id().to_string()]).status().unwrap();
        let since = Instant::now();
        let status = child.wait().unwrap();
        assert!(since.elapsed() < Duration::from_secs(5), "{signal}: {:?}", since.elapsed());
        assert_eq!(status.code(), Some(code));
        assert!(!cut.join("lot").exists());
    }
    assert!(run(&cut).status().unwrap().success());
    assert_eq!(contents(&cut.join("lot")), contents(&whole.join("lot")));
}

#[test]
fn killed_runs_do_not_change_the_next_result() {
    let temp = tempfile::tempdir().unwrap();
    let (whole, cut) = (temp.path().join("whole"), temp.path().join("cut"));
    let run = |out: &Path| {
        let mut run = process();
        run.arg("run").arg(clip()).arg("--out").arg(out).arg("--resume").args(SHORT);
        run.stderr(Stdio::null());
        run
    };
    assert!(run(&whole).status().unwrap().success());
    for i in 0..6_u64 {
        let mut child = run(&cut).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(200 + 350 * i));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert!(run(&cut).status().unwrap().success());
    assert_eq!(contents(&cut.join("lot")), contents(&whole.join("lot")));
    assert_eq!(names(&cut), [".roadplane.lock", "lot"]);
}

#[test]
fn a_folder_that_cannot_be_written_is_named() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("a-file");
    fs::write(&file, "no folder").unwrap();
    for out in [file.join("out"), PathBuf::from("/proc/roadplane"), PathBuf::from("/dev/null/out")] {
        let output = process().arg("run").arg(clip()).args(SHORT).arg("--out").arg(&out).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{}", said(&output));
        assert!(said(&output).contains(out.to_str().unwrap()), "{}", said(&output));
    }
    // The folder is read-only, but the user root can write to it.
    let locked = temp.path().join("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    if fs::write(locked.join("probe"), "").is_ok() {
        println!("skipped: this user may write into read-only folders (scripts/reliability mounts one)");
        return;
    }
    let output = process().arg("run").arg(clip()).args(SHORT).arg("--out").arg(&locked).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
}

#[test]
fn a_run_that_lacks_space_continues_with_other_options() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    let run = |mut command: Command, options: &[&str]| {
        let run = command.arg("run").arg(clip()).args(SHORT).args(options).arg("--out").arg(&out);
        run.output().unwrap()
    };
    let output = run(limited("trap '' XFSZ; ulimit -f 150"), &["--background", "--frames"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let left = names(&out.join(".lot.partial"));
    assert!(left.contains(&"frames.jsonl".to_owned()) && !out.join("lot").exists(), "{left:?}");
    let output = run(process(), &["--resume"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let left = names(&out.join("lot"));
    assert!(left.contains(&"tracks.csv".to_owned()), "{left:?}");
    assert!(!left.iter().any(|name| name.starts_with("background.") || name == "frames.jsonl"), "{left:?}");
}

#[test]
fn a_folder_that_vanishes_ends_the_run_with_its_name() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    let mut run = process();
    run.arg("run").arg(clip()).arg("--out").arg(&out).args(["--set", "decode.max_frames=60"]);
    let child = run.stderr(Stdio::piped()).spawn().unwrap();
    while !out.join(".lot.partial/frames.jsonl").exists() {
        std::thread::sleep(Duration::from_millis(10));
    }
    fs::remove_dir_all(&out).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains(out.to_str().unwrap()) && !said(&output).contains("panicked"));
}

#[test]
fn the_second_of_two_runs_on_one_folder_is_refused_at_once() {
    let temp = tempfile::tempdir().unwrap();
    let mut run = process();
    run.arg("run").arg(clip()).arg("--out").arg(temp.path()).args(["--set", "decode.max_frames=60"]);
    let mut first = run.stderr(Stdio::null()).spawn().unwrap();
    while !temp.path().join(".roadplane.lock").exists() {
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(100));
    let since = Instant::now();
    let output = process().arg("run").arg(clip()).arg("--out").arg(temp.path()).output().unwrap();
    assert_eq!(output.status.code(), Some(11), "{}", said(&output));
    // The rejection takes a second if nothing else runs. Most of this time is spent on loading the libraries.
    assert!(since.elapsed() < Duration::from_secs(5), "{:?}", since.elapsed());
    assert!(first.wait().unwrap().success(), "the first is not disturbed");
}

#[test]
fn a_clip_that_grows_while_it_is_read_is_damaged_or_complete() {
    let temp = tempfile::tempdir().unwrap();
    let whole = fs::read(clip()).unwrap();
    let growing = temp.path().join("growing.mp4");
    fs::write(&growing, &whole[..whole.len() / 3]).unwrap();
    let mut run = process();
    run.arg("run").arg(&growing).args(SHORT).arg("--out").arg(temp.path().join("out"));
    let child = run.stderr(Stdio::piped()).spawn().unwrap();
    let mut file = fs::OpenOptions::new().append(true).open(&growing).unwrap();
    for part in whole[whole.len() / 3..].chunks(whole.len() / 20) {
        std::thread::sleep(Duration::from_millis(50));
        file.write_all(part).unwrap();
    }
    let output = child.wait_with_output().unwrap();
    assert!(matches!(output.status.code(), Some(0 | 3)), "{:?} {}", output.status, said(&output));
    assert!(!said(&output).contains("panicked"));
}

#[test]
fn playlists_addresses_and_links_are_not_followed() {
    let temp = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = temp.path().join(name);
        fs::write(&path, text).unwrap();
        path
    };
    let lot = clip().display().to_string();
    let dangling = temp.path().join("dangling.mp4");
    std::os::unix::fs::symlink("/nowhere/at/all.mp4", &dangling).unwrap();
    let secret = temp.path().join("secret.mp4");
    std::os::unix::fs::symlink("/etc/passwd", &secret).unwrap();
    for input in [
        put("list.m3u8", &format!("#EXTM3U\n#EXTINF:2,\n{lot}\n")),
        put("list.mp4", &format!("#EXTM3U\n#EXTINF:2,\n{lot}\n")),
        put("script.mp4", &format!("ffconcat version 1.0\nfile {lot}\n")),
        put("call.sdp", "v=0\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\n"),
        PathBuf::from("http://127.0.0.1:9/a.mp4"),
        PathBuf::from("rtsp://127.0.0.1/a"),
        PathBuf::from(format!("concat:{lot}|{lot}")),
        dangling,
        secret,
    ] {
        let out = temp.path().join("out");
        let output = process().arg("run").arg(&input).arg("--out").arg(&out).output().unwrap();
        // If the file exists, the input is at fault (3). If the file is missing, the command line is at fault (2).
        let code = if input.exists() { 3 } else { 2 };
        assert_eq!(output.status.code(), Some(code), "{}: {}", input.display(), said(&output));
        assert_eq!(names(&out), [".roadplane.lock"], "{}", input.display());
    }
}

#[test]
fn links_that_lead_out_of_a_folder_of_pictures_are_not_followed() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = root().join("tests/data/lots/scenes");
    let folder = temp.path().join("pictures");
    fs::create_dir(&folder).unwrap();
    fs::copy(scenes.join("still_0000.jpg"), folder.join("a.jpg")).unwrap();
    std::os::unix::fs::symlink(folder.join("a.jpg"), folder.join("b.jpg")).unwrap();
    std::os::unix::fs::symlink(scenes.join("still_0001.jpg"), folder.join("c.jpg")).unwrap();
    let out = temp.path().join("out");
    let output = process().arg("run").arg(&folder).arg("--out").arg(&out).output().unwrap();
    if out.join("pictures/summary.json").is_file() && output.status.success() {
        println!("skipped: this kernel has no Landlock");
        return;
    }
    assert_eq!(output.status.code(), Some(3), "{}", said(&output));
    assert!(said(&output).contains("c.jpg") && !out.join("pictures").exists(), "{}", said(&output));
    fs::remove_file(folder.join("c.jpg")).unwrap();
    assert!(process().arg("run").arg(&folder).arg("--out").arg(&out).output().unwrap().status.success());
}

#[test]
fn one_bad_input_does_not_stop_the_night_and_is_counted() {
    let temp = tempfile::tempdir().unwrap();
    let bad = temp.path().join("bad.mp4");
    fs::write(&bad, "no video").unwrap();
    let metrics = temp.path().join("roadplane.prom");
    let output = process()
        .args(["--log-format", "json", "run"])
        .args([&bad, &clip()])
        .args(SHORT)
        .args(["--run-id", "night-1", "--cameras"])
        .arg(temp.path().join("cameras"))
        .args(["--camera-id", "gate", "--metrics-file"])
        .arg(&metrics)
        .arg("--out")
        .arg(temp.path().join("out"))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", said(&output));
    assert!(temp.path().join("out/lot/summary.json").is_file());
    let text = fs::read_to_string(&metrics).unwrap();
    for line in [
        "roadplane_inputs{state=\"done\"} 1",
        "roadplane_inputs{state=\"failed\"} 1",
        "roadplane_failures_total{fault=\"input\"} 1",
        "roadplane_frames_total 12",
    ] {
        assert!(text.lines().any(|l| l == line), "{line} is missing in\n{text}");
    }
    let lines: Vec<serde_json::Value> =
        said(&output).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let has = |line: &serde_json::Value, key: &str, value: &str| {
        line["spans"].as_array().is_some_and(|spans| spans.iter().any(|span| span[key] == value))
    };
    assert!(
        lines
            .iter()
            .any(|l| has(l, "run_id", "night-1") && has(l, "camera", "gate") && has(l, "clip", "lot"))
    );
}

#[test]
fn counts_are_served_while_running() {
    let temp = tempfile::tempdir().unwrap();
    let address = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut run = process();
    run.arg("run").arg(clip()).args(["--set", "decode.max_frames=60", "--metrics", &address.to_string()]);
    let mut child = run.arg("--out").arg(temp.path()).stderr(Stdio::null()).spawn().unwrap();
    let mut text = String::new();
    for _ in 0..100 {
        std::thread::sleep(Duration::from_millis(50));
        let Ok(mut stream) = std::net::TcpStream::connect(address) else { continue };
        write!(stream, "GET /metrics HTTP/1.1\r\n\r\n").unwrap();
        stream.read_to_string(&mut text).unwrap();
        break;
    }
    assert!(text.contains("roadplane_inputs{state=\"running\"}"), "{text}");
    assert!(child.wait().unwrap().success());
    let open =
        process().args(["run", "x", "--out"]).arg(temp.path()).args(["--metrics", "0.0.0.0:9"]).output();
    assert_eq!(open.unwrap().status.code(), Some(2));
}

#[test]
fn a_reader_that_closes_the_output_ends_it_quietly() {
    let temp = tempfile::tempdir().unwrap();
    let mut detect = process();
    detect.args(["stage", "detect"]).arg(clip()).args(["--out", "-", "--set", "decode.max_frames=200"]);
    let mut child = detect.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.starts_with('{'));
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert!(!said(&output).contains("panicked"));
    drop(temp);
}

#[test]
fn threads_and_order_change_no_byte() {
    let temp = tempfile::tempdir().unwrap();
    let still = root().join("tests/data/lots/scenes/still_0000.jpg");
    let mut expected = None;
    for (i, (jobs, inputs)) in
        [("1", [clip(), still.clone()]), ("2", [still.clone(), clip()]), ("2", [clip(), still.clone()])]
            .into_iter()
            .enumerate()
    {
        let out = temp.path().join(i.to_string());
        let mut run = process();
        run.arg("run").args(&inputs).args(["--jobs", jobs]).args(SHORT).arg("--out").arg(&out);
        assert!(run.output().unwrap().status.success());
        let all = [contents(&out.join("lot")), contents(&out.join("still_0000"))];
        assert_eq!(expected.get_or_insert_with(|| all.clone()), &all);
    }
}
