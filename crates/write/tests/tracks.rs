//! The three track files have the same numbers. Their bytes are the same each time, and other libraries can read them.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::process::Command;

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::RowAccessor as _;
use roadplane_base::{OnMap, TrackRow};
use roadplane_write::{TrackFiles, WriteError, read_jsonl};

fn row(frame: u64, track: u64) -> TrackRow {
    let t = frame as f64 / 30.0;
    TrackRow {
        x_m: 1.0 / 3.0 + track as f64,
        y_m: 20.0 + 5.0 * t,
        heading_rad: std::f64::consts::FRAC_PI_2,
        speed_mps: 5.0,
        x_sd_m: 0.0123,
        heading_sd_rad: 0.001_234_5,
        bbox_px: [10.0, 20.0 + t, 110.123_456, 90.0],
        observed: frame.is_multiple_of(2),
        activity: (track == 2).then(|| "turn_left, \"wide\"".to_owned()),
        activity_p: (track == 2).then_some(0.75),
        x_own_sd_m: (track == 2).then_some(0.012_34),
        y_own_sd_m: (track == 2).then_some(0.05),
        exists_p: Some(0.987_65),
        same_vehicle_p: (track == 2).then_some(0.876_54),
        ..roadplane_synth::stationary_row(track, frame, t)
    }
}

fn rows() -> Vec<TrackRow> {
    (0..40).flat_map(|frame| [row(frame, 1), row(frame, 2)]).collect()
}

fn write(folder: &std::path::Path) {
    let mut files = TrackFiles::create(folder, false).unwrap();
    rows().iter().for_each(|row| files.write(row).unwrap());
    files.finish().unwrap();
}

#[test]
fn the_three_files_agree_and_repeat() {
    let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    write(a.path());
    write(b.path());
    for name in ["tracks.parquet", "tracks.jsonl", "tracks.csv"] {
        let read = |dir: &tempfile::TempDir| std::fs::read(dir.path().join(name)).unwrap();
        assert_eq!(read(&a), read(&b), "{name}");
    }
    let lines: Vec<TrackRow> =
        read_jsonl(&a.path().join("tracks.jsonl")).unwrap().map(Result::unwrap).collect();
    assert_eq!(lines.len(), 80);
    assert!(lines.iter().zip(rows()).all(|(l, r)| (l.y_m - r.y_m).abs() < 1e-4 && l.activity == r.activity));
    assert_eq!(lines[0].x_m.to_string(), "1.3333", "digits are cut");

    let mut csv = csv::Reader::from_path(a.path().join("tracks.csv")).unwrap();
    let records: Vec<csv::StringRecord> = csv.records().map(Result::unwrap).collect();
    assert_eq!(records.len(), 80);
    assert_eq!(&records[1][19], "turn_left, \"wide\"");
    assert_eq!((&records[0][15], &records[0][19]), ("110.12", ""));

    let file = std::fs::File::open(a.path().join("tracks.parquet")).unwrap();
    let reader = SerializedFileReader::new(file).unwrap();
    for (found, line) in reader.get_row_iter(None).unwrap().map(Result::unwrap).zip(&lines) {
        assert_eq!(found.get_long(0).unwrap().cast_unsigned(), line.frame);
        assert_eq!(found.get_double(4).unwrap().to_bits(), line.y_m.to_bits());
        let bbox = found.get_list(13).unwrap();
        assert_eq!(bbox.len(), 4);
        assert_eq!(found.get_bool(15).unwrap(), line.observed);
        assert_eq!(found.get_string(16).ok(), line.activity.as_ref());
        assert_eq!(found.get_double(20).ok(), line.activity_p);
        assert_eq!(
            (found.get_double(21).ok(), found.get_double(22).ok()),
            (line.x_own_sd_m, line.y_own_sd_m)
        );
    }
}

#[test]
fn positions_on_the_map_are_columns() {
    let dir = tempfile::tempdir().unwrap();
    let on_map = OnMap {
        latitude: 51.05,
        longitude: 13.740_000_000_4,
        utm_zone: "33N".to_owned(),
        east_m: 411_000.123_46,
        north_m: 5_656_000.5,
        east_sd_m: 0.25,
        north_sd_m: 0.5,
        bearing_deg: 359.75,
    };
    let mut files = TrackFiles::create(dir.path(), true).unwrap();
    files.write(&TrackRow { on_map: Some(on_map), ..row(0, 1) }).unwrap();
    files.write(&row(1, 1)).unwrap();
    files.finish().unwrap();
    let lines: Vec<TrackRow> =
        read_jsonl(&dir.path().join("tracks.jsonl")).unwrap().map(Result::unwrap).collect();
    let found = lines[0].on_map.as_ref().unwrap();
    assert_eq!((found.longitude, found.east_m, lines[1].on_map.as_ref()), (13.74, 411_000.123_5, None));

    let mut csv = csv::Reader::from_path(dir.path().join("tracks.csv")).unwrap();
    let header = csv.headers().unwrap().clone();
    let records: Vec<csv::StringRecord> = csv.records().map(Result::unwrap).collect();
    let cell = |i: usize, name: &str| records[i][header.iter().position(|h| h == name).unwrap()].to_owned();
    assert_eq!(cell(0, "longitude"), "13.740000000");
    assert_eq!((cell(0, "utm_zone").as_str(), cell(0, "bearing_deg").as_str()), ("33N", "359.750"));
    assert_eq!(cell(1, "east_m"), "");

    let file = std::fs::File::open(dir.path().join("tracks.parquet")).unwrap();
    let reader = SerializedFileReader::new(file).unwrap();
    let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
    assert_eq!(rows[0].len(), 35);
    assert_eq!(rows[0].get_double(30).ok(), Some(411_000.123_5));
    assert_eq!(rows[0].get_string(29).unwrap(), "33N");
    assert!(rows[1].get_double(27).is_err(), "null");
}

#[test]
fn golden_lines() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    let text = |name: &str| std::fs::read_to_string(dir.path().join(name)).unwrap();
    let start = |text: &str| text.lines().take(3).collect::<Vec<_>>().join("\n") + "\n";
    assert_eq!(start(&text("tracks.jsonl")), include_str!("golden/tracks.jsonl"));
    assert_eq!(start(&text("tracks.csv")), include_str!("golden/tracks.csv"));
}

#[test]
fn a_number_that_is_not_finite_is_rejected() {
    let dir = tempfile::tempdir().unwrap();
    let mut files = TrackFiles::create(dir.path(), false).unwrap();
    let broken = TrackRow { speed_mps: f64::NAN, ..row(7, 3) };
    let error = files.write(&broken).unwrap_err();
    assert!(
        matches!(&error, WriteError::NotFinite { what, .. } if what == "speed_mps of track 3 in frame 7")
    );
    drop(files);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "no partial file");
}

#[test]
fn no_rows_make_readable_files() {
    let dir = tempfile::tempdir().unwrap();
    TrackFiles::create(dir.path(), false).unwrap().finish().unwrap();
    let file = std::fs::File::open(dir.path().join("tracks.parquet")).unwrap();
    assert_eq!(SerializedFileReader::new(file).unwrap().metadata().file_metadata().num_rows(), 0);
    assert!(std::fs::read_to_string(dir.path().join("tracks.csv")).unwrap().starts_with("frame,time_s,"));
}

/// This test mounts a file system. It is skipped without the right to do so.
#[test]
fn a_small_disk_fills_up_cleanly() {
    let dir = tempfile::tempdir().unwrap();
    let mounted = Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=256k", "tmpfs"])
        .arg(dir.path())
        .output()
        .is_ok_and(|out| out.status.success());
    if !mounted {
        println!("skipped: no right to mount a small disk");
        return;
    }
    let outcome = (|| {
        let mut files = TrackFiles::create(dir.path(), false)?;
        for frame in 0..50_000 {
            files.write(&row(frame, 1))?;
        }
        files.finish()
    })();
    let left = std::fs::read_dir(dir.path()).unwrap().count();
    assert!(Command::new("umount").arg(dir.path()).status().unwrap().success());
    assert!(matches!(outcome, Err(WriteError::DiskFull { .. })), "{outcome:?}");
    assert_eq!(left, 0, "no final name and no temporary file");
}
