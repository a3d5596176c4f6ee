//! The files match their schemas: every field is described, and every required field is present.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;

use nalgebra::{Isometry3, Matrix4};
use roadplane_base::{
    CameraEstimate, CameraParams, CameraStatus, CarRecord, FrameRecord, ImageSize, KEYPOINTS, Lens, MODES,
    OnMap, PoseRecord, TrackRow, VehicleClass, WatchRecord, WeakBox, rows_from_isometry,
};
use roadplane_write::{
    CpuMs, FRAMES_SCHEMA, FrameSpool, POSES_SCHEMA, PoseLines, SUMMARY_SCHEMA, Speed, StageSeconds, Summary,
    TrackFiles, WriteError, read_jsonl, read_summary, schemas, write_camera, write_summary,
};
use serde_json::Value;

const SIZE: ImageSize = ImageSize { width: 640, height: 360 };

fn pose() -> PoseRecord {
    let rows = rows_from_isometry(&Isometry3::translation(1.0 / 3.0, 20.0, 0.0));
    PoseRecord {
        frame: 3,
        time_s: 0.12,
        car: 1,
        track: Some(2),
        bbox_px: [10.0, 20.0, 110.126, 90.0],
        score: 0.9,
        class: VehicleClass::Car,
        world_from_car: rows,
        camera_from_car: rows,
        shape: [0.123_456; MODES],
        dims_m: [4.5, 1.8, 1.5],
        pose_sd: [Some(0.123_456), Some(f64::INFINITY), None],
        keypoints_px: [Some([50.126, 60.0, 0.9, 1.234_5]), None].repeat(KEYPOINTS / 2),
        reprojection_rms_px: 1.5,
        used: true,
        pose_from: None,
    }
}

fn on_map() -> OnMap {
    OnMap {
        latitude: 51.05,
        longitude: 13.74,
        utm_zone: "33N".to_owned(),
        east_m: 411_000.5,
        north_m: 5_656_000.5,
        east_sd_m: 0.25,
        north_sd_m: 0.5,
        bearing_deg: 359.75,
    }
}

fn summary() -> Summary {
    let cpu_ms_per_frame =
        CpuMs { total: 20.000_04, decode: 5.0, detect: 6.0, detect_net: 5.5, ..CpuMs::default() };
    let speed =
        Speed { frames: 50, clip_s: 2.0, wall_s: 1.000_4, crops: 25, cpu_ms_per_frame, ..Speed::default() };
    Summary {
        seconds: vec![StageSeconds { stage: "decode".to_owned(), seconds: 0.25 }],
        speed: Some(speed),
        ..Summary::default()
    }
}

/// Writes one file of each kind into a folder.
fn write_all(folder: &Path) {
    let mut tracks = TrackFiles::create(folder, true).unwrap();
    let row = TrackRow {
        on_map: Some(on_map()),
        activity: Some("turn_left".to_owned()),
        activity_p: Some(0.75),
        ..roadplane_synth::stationary_row(2, 3, 0.12)
    };
    tracks.write(&row).unwrap();
    tracks.finish().unwrap();
    let mut poses = PoseLines::create(&folder.join("poses.jsonl")).unwrap();
    poses.write(&pose()).unwrap();
    poses.finish().unwrap();
    let (mut frames, _) = FrameSpool::open(&folder.join("frames.jsonl"), |_| 0).unwrap();
    let frame = FrameRecord {
        watch: Some(WatchRecord { offset_px: [1.0, 0.0], changed: Some(0.5), ..WatchRecord::default() }),
        scene_lines: Some(Vec::new()),
        scene_curves: Some(Vec::new()),
        cars: vec![CarRecord::boxed([1.0, 2.0, 31.0, 22.0])],
        weak: vec![WeakBox { bbox_px: [51.0, 2.0, 81.0, 22.0], score: 0.2, colour_rgb: Some([1, 2, 3]) }],
        ..FrameRecord::empty(3, 0.12, SIZE)
    };
    frames.append(&frame).unwrap();
    frames.sync().unwrap();
    let estimate = CameraEstimate {
        span_s: [0.0, 1.0],
        image_size_px: SIZE,
        principal_point_px: SIZE.centre_px(),
        lens: Lens::with_distortion(-0.05, SIZE),
        distortion_sd: Some(0.01),
        params: CameraParams { log_focal: 800_f64.ln(), tilt: 0.3, roll: 0.0, log_height: 2.0 },
        covariance: Matrix4::identity() * 1e-4,
        status: CameraStatus::Estimated,
        cars_used: 4,
        frames_used: 9,
        second_plane: None,
    };
    write_camera(&folder.join("camera.json"), &[estimate], Vec::new()).unwrap();
    write_summary(&folder.join("summary.json"), &summary()).unwrap();
}

#[test]
fn files_match_their_schemas() {
    let folder = tempfile::tempdir().unwrap();
    write_all(folder.path());
    let mut checked = 0;
    for (name, schema) in schemas() {
        let [json, lines] = ["json", "jsonl"].map(|end| folder.path().join(format!("{name}.{end}")));
        let written: Value = if json.exists() {
            serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap()
        } else if lines.exists() {
            read_jsonl(&lines).unwrap().next().unwrap().unwrap()
        } else {
            assert_eq!(name, "known", "files of the user are not written");
            continue;
        };
        let fields = written.as_object().unwrap();
        let properties = schema["properties"].as_object().unwrap();
        let undescribed: Vec<_> = fields.keys().filter(|field| !properties.contains_key(*field)).collect();
        assert!(undescribed.is_empty(), "{name}: the schema does not describe {undescribed:?}");
        let required = schema["required"].as_array().unwrap();
        assert!(required.iter().all(|field| fields.contains_key(field.as_str().unwrap())), "{name}");
        checked += 1;
    }
    assert_eq!(checked, 5);
    let ids: Vec<Value> = schemas().into_iter().map(|(_, schema)| schema["$id"].clone()).collect();
    assert!(ids.contains(&POSES_SCHEMA.into()) && ids.contains(&FRAMES_SCHEMA.into()));
}

#[test]
fn poses_are_read_back_with_the_digits_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    write_all(folder.path());
    let back: PoseRecord = read_jsonl(&folder.path().join("poses.jsonl")).unwrap().next().unwrap().unwrap();
    assert_eq!(back.world_from_car[0][3].to_string(), "0.333333");
    assert_eq!(
        (back.bbox_px[2], back.shape[0], back.keypoints_px[0]),
        (110.13, 0.1235, Some([50.13, 60.0, 0.9, 1.235]))
    );
    assert_eq!(back.pose_sd, [Some(0.1235), None, None], "sds to four digits, infinite ones null");
    assert_eq!((back.track, back.used, back.keypoints_px[1]), (Some(2), true, None));
}

#[test]
fn poses_that_are_not_finite_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let mut poses = PoseLines::create(&folder.path().join("poses.jsonl")).unwrap();
    let mut wrong = pose();
    wrong.camera_from_car[1][3] = f64::NAN;
    for wrong in [wrong, PoseRecord { shape: [f64::INFINITY; MODES], ..pose() }] {
        let error = poses.write(&wrong).unwrap_err();
        assert!(
            matches!(&error, WriteError::NotFinite { what, .. } if what == "the pose of car 1 in frame 3"),
            "{error}"
        );
    }
    drop(poses);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "no partial file");
}

#[test]
fn errors_name_the_number_that_is_not_finite() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = TrackFiles::create(folder.path(), true).unwrap();
    let row = TrackRow { on_map: Some(on_map()), ..roadplane_synth::stationary_row(2, 3, 0.12) };
    type Spoil = fn(&mut TrackRow);
    let spoilt: [(Spoil, &str); 5] = [
        (|row| row.x_m = f64::NAN, "x_m"),
        (|row| row.bbox_px[3] = f64::INFINITY, "bbox_px"),
        (|row| row.activity_p = Some(f64::NAN), "activity_p"),
        (|row| row.y_own_sd_m = Some(f64::NAN), "y_own_sd_m"),
        (|row| row.on_map.as_mut().unwrap().north_sd_m = f64::INFINITY, "north_sd_m"),
    ];
    for (spoil, name) in spoilt {
        let mut wrong = row.clone();
        spoil(&mut wrong);
        let error = files.write(&wrong).unwrap_err();
        assert!(error.to_string().starts_with(&format!("{name} of track 2 in frame 3")), "{error}");
    }
    files.write(&row).unwrap();
}

#[test]
fn a_summary_contains_the_time_of_the_run() {
    let folder = tempfile::tempdir().unwrap();
    write_all(folder.path());
    let back = read_summary(&folder.path().join("summary.json")).unwrap();
    assert_eq!(back.schema, SUMMARY_SCHEMA);
    let speed = back.speed.unwrap();
    assert_eq!((speed.wall_s, speed.cpu_ms_per_frame.total), (1.0, 20.0), "digits are cut");
    assert_eq!((speed.frames_per_s(), speed.times_real_time(), speed.crops_per_frame()), (50.0, 2.0, 0.5));
    assert_eq!(speed.cpu_ms_per_frame.nets(), 5.5);
    // The speeds of a run without frames are 0.
    let none = Speed::default();
    let speeds =
        [none.frames_per_s(), none.times_real_time(), none.inference_frames_per_s(), none.crops_per_frame()];
    assert!(speeds.iter().all(|speed| speed.abs() < f64::EPSILON));
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("poses.jsonl");
    let error = read_jsonl::<Value>(&missing).err().unwrap();
    assert!(matches!(&error, WriteError::Io { path, .. } if *path == missing), "{error}");
    std::fs::write(folder.path().join("summary.json"), "{\"status\": \"lost\"}").unwrap();
    let error = read_summary(&folder.path().join("summary.json")).unwrap_err();
    assert!(matches!(&error, WriteError::Malformed { .. }) && error.to_string().ends_with("summary.json"));
}
