//! Tests `roadplane traffic` on tracks of another program, and the tables that every run writes.

use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::{json, names, roadplane, root};

/// Ten vehicles that drive along x at 10 m/s, one every 30 s, as a table with the fewest columns.
fn table(path: &Path) {
    let mut text = "time_s,track,x_m,y_m\n".to_owned();
    for track in 0..10 {
        for i in 0..=60 {
            let (time, x) = (30.0 * f64::from(track) + f64::from(i) / 10.0, f64::from(i) - 30.0);
            text += &format!("{time:.1},{},{x},5\n", track + 1);
        }
    }
    std::fs::write(path, text).unwrap();
}

/// A folder with such a table and with a file of gates.
struct Trial {
    dir: tempfile::TempDir,
}

impl Trial {
    fn new(gates: &str) -> Self {
        let trial = Self { dir: tempfile::tempdir().unwrap() };
        table(&trial.path("t.csv"));
        std::fs::write(trial.path("g.geojson"), gates).unwrap();
        trial
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Runs the command on the table.
    fn run(&self, more: &[&str]) -> Output {
        let mut command = roadplane();
        command.arg("traffic").arg(self.path("t.csv")).arg("--out").arg(self.path("out")).args(more);
        command.output().unwrap()
    }
}

const GATES: &str = r#"{"type": "FeatureCollection", "coordinates": "metres", "features": [
    {"type": "Feature", "properties": {"name": "west"},
     "geometry": {"type": "LineString", "coordinates": [[-20.05, 10], [-20.05, 0]]}},
    {"type": "Feature", "properties": {"name": "east"},
     "geometry": {"type": "LineString", "coordinates": [[20.05, 10], [20.05, 0]]}}]}"#;

fn csv(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn tracks_of_another_program_are_counted_by_local_time() {
    let trial = Trial::new(GATES);
    let (gates, out) = (trial.path("g.geojson"), trial.path("out"));
    let gates = gates.to_str().unwrap();
    let options =
        ["--start", "2026-10-25T01:59", "--time-zone", "Europe/Berlin", "--every", "1min", "--units", "mph"];
    let options = [&["--gates", gates][..], &options].concat();
    let done = trial.run(&options);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let counts = csv(&out.join("counts.csv"));
    let column = |name: &str| counts[0].iter().position(|column| column == name).unwrap();
    let east: Vec<_> = counts
        .iter()
        .filter(|row| row[column("place")] == "east" && row[column("direction")] == "backward")
        .filter(|row| row[column("class")] == "all")
        .map(|row| (row[column("from")].as_str(), row[column("vehicles")].as_str()))
        .collect();
    assert_eq!(east[..2], [("2026-10-25T01:59:00+02:00", "2"), ("2026-10-25T02:00:00+02:00", "2")]);
    assert_eq!(east.len(), 5);
    let picture = std::fs::read_to_string(out.join("pictures/t-east-backward-periods.svg")).unwrap();
    assert!(picture.starts_with("<svg xmlns=") && picture.contains("02:00: 2"), "{picture}");
    // Tracks without sds have no intervals.
    assert!(counts[1..].iter().all(|row| row[column("vehicles_low")].is_empty()));
    let speeds = csv(&out.join("speeds.csv"));
    let v85 = speeds[0].iter().position(|column| column == "v85_mph").unwrap();
    assert!(speeds[1..].iter().all(|row| (row[v85].parse::<f64>().unwrap() - 22.3694).abs() < 1e-3));
    let flows = csv(&out.join("flows.csv"));
    assert!(flows[1..].iter().all(|row| row[1] == "west" && row[7] == "east"), "{flows:?}");
    let file = json(&out.join("traffic.json"));
    assert_eq!(file["cameras"][0]["clips"][0]["vehicles"], 10);
    let in_lane = |row: &serde_json::Value| row["place"] == "east" && row["direction"] == "backward";
    let lanes: Vec<_> = file["lanes"].as_array().unwrap().iter().filter(|row| in_lane(row)).collect();
    assert_eq!(lanes.iter().map(|row| row["vehicles"].as_u64().unwrap()).sum::<u64>(), 10, "{lanes:?}");
    assert!(names(&out).contains(&"traffic.html".to_owned()));

    // A finished folder is kept, and the same command gives the same bytes.
    assert_eq!(trial.run(&options).status.code(), Some(2));
    let before = std::fs::read(out.join("traffic.json")).unwrap();
    let again = trial.run(&[&options[..], &["--overwrite"]].concat());
    assert!(again.status.success());
    assert_eq!(std::fs::read(out.join("traffic.json")).unwrap(), before);
}

#[test]
fn faults_are_refused_before_anything_is_written() {
    let trial = Trial::new(&GATES.replace("metres", "pixels"));
    let (gates, out) = (trial.path("g.geojson"), trial.path("out"));
    let gates = gates.to_str().unwrap();
    for (more, word) in [
        (vec!["--every", "7min"], "divides a day"),
        (vec!["--time-zone", "Atlantis"], "no time zone"),
        (vec!["--start", "tonight"], "local date and time"),
        (vec!["--gates", gates], "camera.json"),
        (vec!["--gates", "none.geojson"], "none.geojson"),
    ] {
        let failed = trial.run(&more);
        let text = String::from_utf8_lossy(&failed.stderr).into_owned();
        assert!(failed.status.code() == Some(2) && text.contains(word), "{more:?}: {text}");
        assert!(!out.exists());
    }
    let empty = trial.path("empty");
    std::fs::create_dir(&empty).unwrap();
    let failed = roadplane().arg("traffic").arg(&empty).arg("--out").arg(&out).output().unwrap();
    assert!(String::from_utf8_lossy(&failed.stderr).contains("no result of a run"));
}

#[test]
fn a_run_with_a_gate_in_pixels_counts_nothing_in_a_parking_lot_at_rest() {
    let dir = tempfile::tempdir().unwrap();
    let gates = dir.path().join("g.geojson");
    let line = r#"{"type": "FeatureCollection", "coordinates": "pixels", "features": [{"type": "Feature",
        "properties": {"name": "row"}, "geometry": {"type": "LineString", "coordinates": [[100, 400], [1100, 400]]}}]}"#;
    std::fs::write(&gates, line).unwrap();
    let run = |gates: &Path, out: &str| {
        let mut command = roadplane();
        command.arg("run").arg(root().join("tests/data/lot.mp4")).arg("--out").arg(dir.path().join(out));
        command.args([
            "--set",
            &format!("traffic.gates={}", gates.display()),
            "--set",
            "decode.max_frames=12",
        ]);
        command.output().unwrap()
    };
    let done = run(&gates, "out");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let file = json(&dir.path().join("out/lot/traffic/traffic.json"));
    assert_eq!(file["cameras"][0]["places"][0]["name"], "row");
    assert_eq!(file["counts"][0]["vehicles"], 0);
    // The same run, as if the camera had been turned in frame 7. The gate belongs to the position that frame 0 shows.
    let edit = |name: &str, change: &dyn Fn(&mut serde_json::Value)| {
        let path = dir.path().join("out/lot").join(name);
        let mut content = json(&path);
        change(&mut content);
        std::fs::write(&path, content.to_string()).unwrap();
    };
    edit("camera.json", &|camera| {
        let mut turned = camera["segments"][0].clone();
        let middle_s = 7.0 / 12.0;
        turned["span_s"][0] = middle_s.into();
        turned["focal_px"] = 1500.0.into();
        camera["segments"][0]["span_s"][1] = (middle_s - 1.0 / 12.0).into();
        camera["segments"].as_array_mut().unwrap().push(turned);
    });
    edit("summary.json", &|summary| {
        let moved = serde_json::json!({"kind": "turned", "since_frame": 7, "since_s": 7.0 / 12.0});
        summary["watch"]["moves"] = serde_json::json!([moved]);
    });
    for (frame, has_gate) in [(0, "lot"), (7, "lot/2")] {
        std::fs::write(&gates, line.replace("\"features\"", &format!("\"frame\": {frame}, \"features\"")))
            .unwrap();
        let mut command = roadplane();
        command.arg("traffic").arg(dir.path().join("out/lot")).arg("--gates").arg(&gates);
        let done = command.args(["--overwrite", "--out"]).arg(dir.path().join("counted")).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let file = json(&dir.path().join("counted/traffic.json"));
        let counts = file["counts"].as_array().unwrap();
        assert!(!counts.is_empty() && counts.iter().all(|row| row["camera"] == has_gate), "{counts:?}");
        let warning = file["warnings"].to_string();
        assert!(warning.contains(&format!("in frame {frame}")), "{warning}");
    }
    let failed = run(&dir.path().join("none"), "none");
    assert_eq!(failed.status.code(), Some(2));
    assert!(!dir.path().join("none").exists());
}
