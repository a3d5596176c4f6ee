//! Files of every format are read back. They contain the numbers of the run.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod fixture;
mod helpers;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Point3, Vector2};
use quick_xml::events::Event;
use roadplane_base::angle_difference;
use roadplane_export::{FORMATS, Format, Run, export};
use roadplane_metrics::readers::{kitti, kpf, mot};
use roadplane_write::{Existing, WriteError};
use serde_json::Value;

use fixture::{MOVED_S, run_folder};
use helpers::{close, exported, track};

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    csv::Reader::from_path(path).unwrap().deserialize().map(Result::unwrap).collect()
}

#[test]
fn mot_is_read_back() {
    let (run, folder, _dir) = exported("mot", false);
    let frames = mot::read_mot(&folder.join("lot.txt")).unwrap();
    assert_eq!(frames.values().map(Vec::len).sum::<usize>(), run.rows().len());
    for (_, row) in run.rows() {
        let (_, bbox) = frames[&(row.frame + 1)].iter().find(|(id, _)| *id == row.track).unwrap();
        bbox.iter().zip(row.bbox_px).for_each(|(a, b)| close(*a, b + 1.0, 0.011));
    }
    let info = std::fs::read_to_string(folder.join("seqinfo.ini")).unwrap();
    assert!(info.contains("frameRate=10.000\nseqLength=60\nimWidth=1280\nimHeight=720\n"), "{info}");
}

#[test]
fn kitti_is_read_back_in_3d() {
    let (run, folder, _dir) = exported("kitti", true);
    let mut rows = 0;
    for segment in &run.segments {
        let tracked = kitti::read_tracked(&folder.join(format!("label_02/{}.txt", segment.name))).unwrap();
        let camera = kitti::read_calib(&folder.join(format!("calib/{}.txt", segment.name))).unwrap();
        close(camera.camera.focal_px, segment.camera.focal_px, 1e-6);
        let world_from_camera = segment.camera.plane().camera_from_world().inverse();
        rows += tracked.len();
        for found in tracked {
            let track = track(&run, u64::try_from(found.track).unwrap());
            let row = track.rows.iter().find(|row| row.frame == found.frame).unwrap();
            let middle = world_from_camera * Point3::from(found.object.location_m);
            close((middle.coords.xy() - track.body_centre(row)).norm(), 0.0, 2e-4);
            close(middle.z, 0.0, 2e-4);
            close(found.object.dims_m[0], row.length_m, 1e-4);
            close(found.object.bbox_px[2], row.bbox_px[2], 0.006);
            // The heading is right, except for the effect of the tilt.
            let forward = found.object.camera_from_box(&camera).rotation * nalgebra::Vector3::x();
            let forward = world_from_camera.rotation * forward;
            close(angle_difference(forward.y.atan2(forward.x), row.heading_rad), 0.0, 0.1);
        }
    }
    assert_eq!(rows, run.rows().len());
    assert_eq!(run.segments.len(), 2);
    assert!(run.segments[1].camera.span_s[0] >= MOVED_S);
}

#[test]
fn kpf_is_read_back() {
    let (run, folder, _dir) = exported("kpf", false);
    let boxes = kpf::read_boxes(&folder.join("lot.geom.yml")).unwrap();
    assert_eq!(boxes.len(), run.rows().len());
    for (found, (_, row)) in boxes.iter().zip(run.rows()) {
        assert_eq!((found.track, found.frame), (row.track, row.frame));
        close(found.time_s, row.time_s, 1e-6);
        found.bbox_px.iter().zip(row.bbox_px).for_each(|(a, b)| close(*a, b, 0.006));
    }
    assert_eq!(kpf::read_types(&folder.join("lot.types.yml")).unwrap().len(), run.tracks.len());
    let text = std::fs::read_to_string(folder.join("lot.activities.yml")).unwrap();
    let packets = yaml_rust2::YamlLoader::load_from_str(&text).unwrap();
    let act = &packets[0][1]["act"];
    close(act["act2"]["vehicle_turns_left"].as_f64().unwrap(), 0.75, 1e-9);
    let span = &act["actors"][0]["timespan"][0]["tsr0"];
    assert_eq!((span[0].as_i64(), span[1].as_i64()), (Some(10), Some(25)));
    assert_eq!(act["actors"][0]["id1"].as_i64(), Some(1));
}

#[test]
fn actev_has_instances_with_boxes() {
    let (run, folder, _dir) = exported("actev", false);
    let json =
        |name: &str| -> Value { serde_json::from_slice(&std::fs::read(folder.join(name)).unwrap()).unwrap() };
    let output = json("lot.json");
    let instance = &output["activities"][0];
    assert_eq!(instance["activity"], "vehicle_turns_left");
    assert_eq!(instance["localization"]["lot.mp4"], serde_json::json!({"11": 1, "27": 0}));
    let boxes = instance["objects"][0]["localization"]["lot.mp4"].as_object().unwrap();
    assert_eq!(boxes.len(), 17, "frames 10 to 25 and the end");
    let row = &track(&run, 1).rows[10];
    close(boxes["11"]["boundingBox"]["x"].as_f64().unwrap(), row.bbox_px[0], 0.5);
    assert_eq!(json("file-index.json")["lot.mp4"]["selected"], serde_json::json!({"1": 1, "61": 0}));
    assert!(json("activity-index.json")["vehicle_turns_left"].is_object());
}

#[test]
fn a_run_without_activities_is_refused_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let run = Run::read(&run_folder(dir.path(), false, false)).unwrap();
    let out = dir.path().join("out");
    let error = export(&run, &[Format::of("actev").unwrap()], &out, Existing::Refuse).unwrap_err();
    assert!(error.to_string().contains("no activities.jsonl"), "{error}");
    assert!(!out.exists());
}

#[test]
fn geojson_has_every_row_and_names_its_unit() {
    let (run, folder, _dir) = exported("geojson", false);
    let json =
        |name: &str| -> Value { serde_json::from_slice(&std::fs::read(folder.join(name)).unwrap()).unwrap() };
    let points = json("lot.rows.geojson");
    assert!(points["coordinate_system"].as_str().unwrap().contains("NOT longitude and latitude"));
    let features = points["features"].as_array().unwrap();
    assert_eq!(features.len(), run.rows().len());
    for (feature, (_, row)) in features.iter().zip(run.rows()) {
        assert_eq!(feature["geometry"]["coordinates"], serde_json::json!([row.x_m, row.y_m]));
        assert_eq!(feature["properties"]["heading_rad"].as_f64(), Some(row.heading_rad));
    }
    let lines = json("lot.tracks.geojson");
    let vertices: usize = lines["features"]
        .as_array()
        .unwrap()
        .iter()
        .map(|line| line["geometry"]["coordinates"].as_array().unwrap().len())
        .sum();
    assert_eq!(vertices, run.rows().len());
}

#[test]
fn sumo_has_the_front_bumpers() {
    let (run, folder, _dir) = exported("sumo-fcd", false);
    let mut reader = quick_xml::Reader::from_file(folder.join("lot.fcd.xml")).unwrap();
    let (mut time_s, mut rows, mut buffer) = (f64::NAN, 0, Vec::new());
    loop {
        let event = reader.read_event_into(&mut buffer).unwrap();
        let (Event::Start(element) | Event::Empty(element)) = &event else {
            if matches!(event, Event::Eof) {
                break;
            }
            continue;
        };
        let get = |name: &str| {
            let value = element.try_get_attribute(name).unwrap().unwrap();
            String::from_utf8(value.value.to_vec()).unwrap()
        };
        match element.name().as_ref() {
            b"timestep" => time_s = number(&get("time")),
            b"vehicle" => {
                let track = track(&run, get("id").parse().unwrap());
                let row = track.rows.iter().find(|row| (row.time_s - time_s).abs() < 1e-6).unwrap();
                let heading = (90.0 - number(&get("angle"))).to_radians();
                close(angle_difference(heading, row.heading_rad), 0.0, 2e-6);
                // In SUMO, a vehicle extends backwards from its front by its length.
                let front = Vector2::new(number(&get("x")), number(&get("y")));
                let middle = front - Vector2::new(heading.cos(), heading.sin()) * row.length_m / 2.0;
                close((middle - track.body_centre(row)).norm(), 0.0, 2e-4);
                close(number(&get("speed")), row.speed_mps, 1e-4);
                assert_eq!(get("type"), format!("track_{}", track.id));
                rows += 1;
            }
            _ => {}
        }
        buffer.clear();
    }
    assert_eq!(rows, run.rows().len());
    let types = std::fs::read_to_string(folder.join("lot.vtypes.xml")).unwrap();
    assert!(types.contains(r#"id="track_2" vClass="truck" length="7.2000""#), "{types}");
}

#[test]
fn ngsim_is_in_feet() {
    let (run, folder, _dir) = exported("ngsim", false);
    let lines = table(&folder.join("lot.csv"));
    assert_eq!(lines.len(), run.rows().len());
    for line in &lines {
        let track = track(&run, line["Vehicle_ID"].parse().unwrap());
        let row = track.rows.iter().find(|row| row.frame.to_string() == line["Frame_ID"]).unwrap();
        let front = track.front(row);
        close(number(&line["Local_X"]) * 0.3048, front.x, 2e-4);
        close(number(&line["Local_Y"]) * 0.3048, front.y, 2e-4);
        close(number(&line["v_Vel"]) * 0.3048, row.speed_mps, 2e-4);
        close(number(&line["Global_Time"]), row.time_s * 1e3, 0.5);
    }
    assert_eq!(lines.iter().filter(|line| line["v_Class"] == "3").count(), track(&run, 2).rows.len());
}

#[test]
fn highd_turns_back_into_the_runs_world() {
    let (run, folder, _dir) = exported("highd", false);
    let axis = number(&table(&folder.join("lot_recordingMeta.csv"))[0]["xAxisHeading"]);
    let lines = table(&folder.join("lot_tracks.csv"));
    assert_eq!(lines.len(), run.rows().len());
    for line in &lines {
        let at = |name: &str| number(&line[name]);
        let track = track(&run, line["id"].parse().unwrap());
        let row = track.rows.iter().find(|row| row.frame.to_string() == line["frame"]).unwrap();
        let middle = Vector2::new(at("x") + at("width") / 2.0, -(at("y") + at("height") / 2.0));
        let middle = nalgebra::Rotation2::new(axis) * middle;
        close((middle - track.body_centre(row)).norm(), 0.0, 1e-3);
        close(at("xVelocity").hypot(at("yVelocity")), row.speed_mps.abs(), 2e-4);
    }
    let meta = table(&folder.join("lot_tracksMeta.csv"));
    assert_eq!(meta.len(), run.tracks.len());
    assert_eq!(meta[0]["drivingDirection"], "2");
}

#[test]
fn the_same_run_gives_the_same_bytes_and_finished_folders_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let run = Run::read(&run_folder(dir.path(), true, true)).unwrap();
    let all: Vec<&Format> = FORMATS.iter().filter(|format| format.lacks(&run).is_none()).collect();
    assert_eq!(all.len() + 1, FORMATS.len(), "only KML is left out");
    let out = |name: &str| dir.path().join(name);
    let mut files = 0;
    let (a, b) =
        (export(&run, &all, &out("a"), Existing::Refuse), export(&run, &all, &out("b"), Existing::Refuse));
    for (a, b) in a.unwrap().iter().zip(b.unwrap()) {
        for entry in std::fs::read_dir(a).unwrap().map(Result::unwrap).filter(|e| e.path().is_file()) {
            assert_eq!(
                std::fs::read(entry.path()).unwrap(),
                std::fs::read(b.join(entry.file_name())).unwrap()
            );
            files += 1;
        }
    }
    assert!(files >= 22, "{files}");
    let again = export(&run, &all[..1], &out("a"), Existing::Refuse).unwrap_err();
    assert!(matches!(again, WriteError::Exists { .. }));
    export(&run, &all[..1], &out("a"), Existing::Overwrite).unwrap();
}
