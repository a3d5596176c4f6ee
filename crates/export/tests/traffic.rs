//! Files for traffic analysis (SSAM, OTVision) and for trackers with a known camera are read back.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod fixture;
mod helpers;

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::Path;

use nalgebra::{Matrix3, Matrix3x4, Vector2, Vector3, Vector4};
use roadplane_export::Run;
use serde_json::{Value, json};

use fixture::run_folder;
use helpers::{close, export_to, exported, rename_input, track};

/// Reads the numbers of a `.trj` file.
struct Bytes(std::vec::IntoIter<u8>);

impl Bytes {
    fn byte(&mut self) -> Option<u8> {
        self.0.next()
    }

    fn four(&mut self) -> [u8; 4] {
        [(); 4].map(|()| self.byte().unwrap())
    }

    fn float(&mut self) -> f32 {
        f32::from_le_bytes(self.four())
    }

    fn int(&mut self) -> i32 {
        i32::from_le_bytes(self.four())
    }
}

#[test]
fn ssam_is_read_back() {
    let (run, folder, _dir) = exported("ssam", true);
    let mut rows = 0;
    for segment in &run.segments {
        let bytes = std::fs::read(folder.join(format!("{}.trj", segment.name))).unwrap();
        let mut file = Bytes(bytes.into_iter());
        assert_eq!(
            (file.byte(), file.byte(), file.float().to_bits()),
            (Some(0), Some(b'L'), 1.04f32.to_bits())
        );
        assert_eq!((file.byte(), file.byte(), file.float().to_bits()), (Some(1), Some(1), 1f32.to_bits()));
        let [x0, y0, x1, y1] = [(); 4].map(|()| f64::from(file.int()));
        let mut time_s = f32::NAN;
        while let Some(record) = file.byte() {
            if record == 2 {
                let next_s = file.float();
                assert!(time_s.is_nan() || next_s > time_s);
                time_s = next_s;
                continue;
            }
            assert_eq!(record, 3);
            let track = track(&run, u64::try_from(file.int()).unwrap());
            let at = |row: &&roadplane_base::TrackRow| row.time_s as f32 == time_s;
            let index = track.rows.iter().position(|row| at(&row)).unwrap();
            let row = &track.rows[index];
            assert_eq!((file.int(), file.byte()), (0, Some(0)), "no link and no lane");
            let found: [f32; 8] = [(); 8].map(|()| file.float());
            let along = Vector2::new(row.heading_rad.cos(), row.heading_rad.sin()) * row.length_m / 2.0;
            let (front, rear) = (track.body_centre(row) + along, track.body_centre(row) - along);
            let told = [front.x, front.y, rear.x, rear.y, row.length_m, row.width_m, row.speed_mps];
            found.iter().zip(told).for_each(|(a, b)| close(f64::from(*a), b, 4e-6));
            assert_eq!(found[7], track.accelerations()[index] as f32);
            assert!(x0 < rear.x.min(front.x) && rear.x.max(front.x) < x1);
            assert!(y0 < rear.y.min(front.y) && rear.y.max(front.y) < y1);
            rows += 1;
        }
    }
    assert_eq!(rows, run.rows().len());
}

#[test]
fn ssam_refuses_numbers_that_do_not_fit() {
    let dir = tempfile::tempdir().unwrap();
    let mut run = Run::read(&run_folder(dir.path(), false, true)).unwrap();
    run.tracks[0].id = 1 << 31;
    let format = roadplane_export::Format::of("ssam").unwrap();
    let refuse = roadplane_write::Existing::Refuse;
    let error = roadplane_export::export(&run, &[format], &dir.path().join("out"), refuse).unwrap_err();
    assert!(error.to_string().contains("track 2147483648"), "{error}");
}

fn ottrk(path: &Path) -> Value {
    let mut text = String::new();
    let file = std::fs::File::open(path).unwrap();
    bzip2::read::BzDecoder::new(file).read_to_string(&mut text).unwrap();
    serde_json::from_str(&text).unwrap()
}

#[test]
fn ottrk_is_read_back() {
    let (run, folder, _dir) = exported("ottrk", true);
    let content = ottrk(&folder.join("lot.ottrk"));
    let detections = content["data"]["detections"].as_array().unwrap();
    assert_eq!(detections.len(), run.rows().len());
    for (found, (track, row)) in detections.iter().zip(run.rows()) {
        let [x0, y0, x1, y1] = row.bbox_px;
        let told = json!({
            "class": if track.id == 1 { "car" } else { "truck" },
            "confidence": 0.8,
            "x": x0, "y": y0, "w": x1 - x0, "h": y1 - y0,
            "interpolated-detection": !row.frame.is_multiple_of(3),
            "first": row.frame == 0,
            "finished": row.frame == 59,
            "track-id": row.track,
            "frame": row.frame + 1,
            "occurrence": row.time_s,
            "input_file_path": "lot.mp4",
        });
        assert_eq!(*found, told);
    }
    let video = json!({
        "filename": "lot", "filetype": ".mp4", "width": 1280, "height": 720, "recorded_fps": 10.0, "actual_fps": 10.0,
        "number_of_frames": 60, "recorded_start_date": 0.0, "length": "0:00:06", "expected_duration": 6,
    });
    assert_eq!(content["metadata"]["video"], video);
    assert_eq!(content["metadata"]["detection"]["normalized_bbox"], false);
    assert_eq!(content["metadata"]["detection"]["model"]["classes"]["7"], "truck");
    assert_eq!(content["metadata"]["tracking"]["last_tracked_video_end"], 6.0);
}

#[test]
fn the_start_of_the_recording_comes_from_the_name_or_from_the_camera_database() {
    let dir = tempfile::tempdir().unwrap();
    let folder = run_folder(dir.path(), false, true);
    assert_eq!(Run::read(&folder).unwrap().start_s, None);
    let zeros = [[0.0; 4]; 4];
    let evidence = json!({
        "schema": "roadplane.evidence/1", "camera": "gate",
        "clip": {"recorded": "2026-01-31T23:00:00", "sha256": "", "name": "lot"},
        "models": [], "image_size_px": [1280, 720], "span_s": [0.0, 5.9], "frames": 60,
        "params": [7.0, 0.3, 0.01, 2.0], "information": zeros, "parked": [], "moving": 1, "place": null,
    });
    std::fs::write(folder.join("evidence.json"), evidence.to_string()).unwrap();
    assert_eq!(Run::read(&folder).unwrap().start_s, Some(1_769_903_999 - 3599));
    rename_input(&folder, "clips/gate_FR20_2026-01-31_23-59-59.mp4");
    let run = Run::read(&folder).unwrap();
    assert_eq!(run.start_s, Some(1_769_903_999));
    let content = ottrk(&export_to(&run, "ottrk", &dir.path().join("out")).join("lot.ottrk"));
    assert_eq!(content["metadata"]["video"]["recorded_start_date"], 1_769_903_999.0);
    let last = content["data"]["detections"].as_array().unwrap().last().unwrap();
    assert_eq!(last["occurrence"], 1_769_904_004.9);
}

/// Returns the numbers of the lines after a heading.
fn numbers(text: &str, heading: &str, lines: usize) -> Vec<f64> {
    let after = text.lines().skip_while(|line| *line != heading).skip(1).take(lines);
    after.flat_map(str::split_whitespace).map(|word| word.parse().unwrap()).collect()
}

#[test]
fn cameras_of_ucmctrack_and_rope3d_project_points_as_the_run_does() {
    let (run, ucmctrack, _a) = exported("ucmctrack", true);
    let (_, rope3d, _b) = exported("rope3d", true);
    let mut planes = BTreeMap::new();
    for segment in &run.segments {
        let file = format!("{}.txt", segment.name);
        let text = std::fs::read_to_string(ucmctrack.join("cam_para").join(&file)).unwrap();
        let rotation = Matrix3::from_row_slice(&numbers(&text, "RotationMatrices", 3));
        let translation_m = Vector3::from_row_slice(&numbers(&text, "TranslationVectors", 1)) / 1000.0;
        let intrinsic = Matrix3::from_row_slice(&numbers(&text, "IntrinsicMatrix", 3));
        let calib = std::fs::read_to_string(rope3d.join("calib").join(&file)).unwrap();
        let p2: Vec<f64> =
            calib.strip_prefix("P2: ").unwrap().split(' ').map(|w| w.trim().parse().unwrap()).collect();
        let p2 = Matrix3x4::from_row_slice(&p2);
        let denorm = std::fs::read_to_string(rope3d.join("denorm").join(&file)).unwrap();
        let denorm: Vec<f64> = denorm.split_whitespace().map(|word| word.parse().unwrap()).collect();
        let denorm = Vector4::from_row_slice(&denorm);
        close(denorm.xyz().norm(), 1.0, 1e-8);
        assert!(denorm.y < 0.0, "the normal points up");
        close(denorm.w, 8.0, 1e-4);
        let camera_from_world = segment.camera.plane().camera_from_world();
        for ground in [[-5.0, 20.0], [3.0, 12.0], [0.0, 60.0]] {
            let point = Vector3::new(ground[0], ground[1], 0.0);
            let in_camera = camera_from_world * nalgebra::Point3::from(point);
            let pixel = segment.camera.camera().pixel_from_camera(&in_camera.coords).unwrap();
            let by_ucmctrack = intrinsic * (rotation * point + translation_m);
            close((by_ucmctrack.xy() / by_ucmctrack.z - pixel).norm(), 0.0, 0.05);
            let by_rope3d = p2 * in_camera.coords.push(1.0);
            close((by_rope3d.xy() / by_rope3d.z - pixel).norm(), 0.0, 0.01);
            close(denorm.dot(&in_camera.coords.push(1.0)), 0.0, 1e-6);
        }
        planes.insert(segment.name.clone(), denorm.z);
    }
    close(planes["lot_1"], -0.3f64.sin(), 1e-4);
    close(planes["lot_2"], -0.35f64.sin(), 1e-4);
}
