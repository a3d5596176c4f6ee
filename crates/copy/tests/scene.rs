//! The files of a scene contain the motion of the run. Writing a scene twice gives the same bytes.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

#[path = "../../export/tests/fixture/mod.rs"]
mod fixture;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector2;
use quick_xml::events::Event;
use roadplane_base::{ShapeAtlas, angle_difference};
use roadplane_copy::{Colours, Scene, at, write_scene};
use roadplane_export::Run;
use serde_json::Value;

use fixture::{MOVED_S, run_folder};

fn scene(dir: &Path, moved: bool) -> (Run, Scene) {
    let run = Run::read(&run_folder(dir, moved, false)).unwrap();
    let colours = Colours::from([(1, [200, 20, 30])]);
    let scene = Scene::of(&run, &colours, &ShapeAtlas::shipped().unwrap()).unwrap();
    (run, scene)
}

fn folder(dir: &Path, name: &str, scene: &Scene) -> std::path::PathBuf {
    let folder = dir.join(name);
    std::fs::create_dir(&folder).unwrap();
    write_scene(scene, &folder).unwrap();
    folder
}

/// Returns the time (s), rear axle (x, y, m) and heading (rad) of each vertex, by the name of the trajectory.
fn vertices(scenario: &Path) -> BTreeMap<String, Vec<[f64; 4]>> {
    let mut reader = quick_xml::Reader::from_file(scenario).unwrap();
    let (mut found, mut name, mut time, mut buffer) = (BTreeMap::new(), String::new(), None, Vec::new());
    loop {
        let event = reader.read_event_into(&mut buffer).unwrap();
        if let Event::Start(element) | Event::Empty(element) = &event {
            let get = |key: &str| {
                String::from_utf8(element.try_get_attribute(key).unwrap().unwrap().value.to_vec()).unwrap()
            };
            let number = |key: &str| get(key).parse::<f64>().unwrap();
            match element.name().as_ref() {
                b"Trajectory" => name = get("name"),
                b"Vertex" => time = Some(number("time")),
                b"WorldPosition" => {
                    if let Some(time) = time.take() {
                        let vertex = [time, number("x"), number("y"), number("h")];
                        found.entry(name.clone()).or_insert_with(Vec::new).push(vertex);
                    }
                }
                _ => {}
            }
        } else if matches!(event, Event::Eof) {
            return found;
        }
        buffer.clear();
    }
}

#[test]
fn every_row_lies_within_two_centimetres_of_the_copied_trajectory() {
    let dir = tempfile::tempdir().unwrap();
    let (run, scene) = scene(dir.path(), false);
    let files = folder(dir.path(), "scene", &scene);
    let found = vertices(&files.join("scenario.xosc"));
    assert_eq!(found.keys().collect::<Vec<_>>(), ["car_1_trajectory"], "the lorry is stationary");
    let vehicle = &scene.vehicles[0];
    let trajectory = &found["car_1_trajectory"];
    assert!(trajectory.len() < run.tracks[0].rows.len());
    for row in &run.tracks[0].rows {
        let pose = at(&vehicle.trajectory, row.time_s).unwrap();
        assert!((pose.x_m - row.x_m).hypot(pose.y_m - row.y_m) < 0.02);
        assert!(angle_difference(pose.heading_rad, row.heading_rad).abs().to_degrees() < 0.5);
        // The same check on the file, which has positions of the rear axle.
        let next = trajectory.partition_point(|v| v[0] <= row.time_s).clamp(1, trajectory.len() - 1);
        let (a, b) = (trajectory[next - 1], trajectory[next]);
        let s = (row.time_s - a[0]) / (b[0] - a[0]);
        let [x, y, h] = [1, 2, 3].map(|i| a[i] + s * (b[i] - a[i]));
        let ours = Vector2::new(row.x_m, row.y_m);
        let theirs = Vector2::new(x, y) + Vector2::new(h.cos(), h.sin()) * vehicle.wheels.half_wheelbase_m;
        assert!((ours - theirs).norm() < 0.02, "{}", (ours - theirs).norm());
    }
    assert!(scene.vehicles[1].is_stationary() && scene.vehicles.len() == 2);
}

#[test]
fn a_moved_camera_leaves_one_segment_and_times_count_from_its_start() {
    let dir = tempfile::tempdir().unwrap();
    let (_, scene) = scene(dir.path(), true);
    assert!((scene.camera.span_s[0] - MOVED_S).abs() < 1e-9 || scene.camera.span_s[0].abs() < 1e-9);
    for vehicle in &scene.vehicles {
        assert!(vehicle.trajectory[0].time_s.abs() < 1e-9);
        assert!(vehicle.span_s[1] <= scene.seconds() + 1e-9);
    }
}

#[test]
fn meshes_are_gltf_of_the_cars_size_and_colour() {
    let dir = tempfile::tempdir().unwrap();
    let (_, scene) = scene(dir.path(), false);
    let files = folder(dir.path(), "scene", &scene);
    let mesh: Value =
        serde_json::from_slice(&std::fs::read(files.join("meshes/car_1.gltf")).unwrap()).unwrap();
    assert_eq!(mesh["asset"]["version"], "2.0");
    let mut high = [f64::MIN; 3];
    for accessor in mesh["accessors"].as_array().unwrap().iter().step_by(2) {
        for (i, high) in high.iter_mut().enumerate() {
            *high = high.max(accessor["max"][i].as_f64().unwrap());
        }
    }
    // The axes are left, up, forward.
    let dims = scene.vehicles[0].dims_m;
    assert!((high[0] - dims[1] / 2.0).abs() < 0.1 && (high[1] - dims[2]).abs() < 0.1, "{high:?} {dims:?}");
    let paint = &mesh["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"];
    assert!(paint[0].as_f64().unwrap() > 10.0 * paint[1].as_f64().unwrap(), "red: {paint}");
}

#[test]
fn the_same_run_gives_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let (_, scene) = scene(dir.path(), false);
    let (a, b) = (folder(dir.path(), "a", &scene), folder(dir.path(), "b", &scene));
    for name in ["scenario.xosc", "road.xodr", "scene.json", "camera.json", "meshes/car_2.gltf"] {
        assert_eq!(std::fs::read(a.join(name)).unwrap(), std::fs::read(b.join(name)).unwrap(), "{name}");
    }
}
