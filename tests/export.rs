//! Tests `roadplane export`: errors, and runs with a position on the map. The tests of the crate `export` check the
//! files.

use nalgebra::Matrix4;
use roadplane_base::{CameraEstimate, CameraParams, CameraStatus, GroundPose, ImageSize};
use roadplane_export::{FORMATS, Run};
use roadplane_geo::{Place, SurveyPoint, UtmZone};
use serde_json::Value;

use crate::common::{json, json_lines, names, number, roadplane, root, shared};

#[test]
fn formats_are_listed_and_unknown_ones_refused() {
    let list = roadplane().args(["export", "--format", "list"]).output().unwrap();
    let text = String::from_utf8(list.stdout).unwrap();
    assert!(list.status.success());
    for name in [
        "mot",
        "kitti",
        "kpf",
        "actev",
        "geojson",
        "geoparquet",
        "kml",
        "sumo-fcd",
        "ngsim",
        "highd",
        "ssam",
        "ottrk",
        "ucmctrack",
        "rope3d",
        "rerun",
    ] {
        assert!(text.lines().any(|line| line.starts_with(&format!("{name} "))), "{name}: {text}");
    }
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("out");
    for (format, word) in [("mott", "there is no format"), ("rerun", "scripts/export/rerun")] {
        let failed =
            roadplane().args(["export", "results/none", "--format", format, "--out"]).arg(&folder).output();
        let failed = failed.unwrap();
        assert_eq!(failed.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&failed.stderr).contains(word));
    }
    assert!(!folder.exists());
}

#[test]
fn a_folder_that_is_no_run_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let failed =
        roadplane().arg("export").arg(dir.path()).args(["--format", "mot", "--out"]).arg(&out).output();
    let failed = failed.unwrap();
    assert_eq!(failed.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&failed.stderr).contains("summary.json"));
    assert_eq!(names(dir.path()), Vec::<String>::new());
}

/// Returns a made-up map position of the demo clip's camera, the true camera, and the text of a file of surveyed
/// points.
fn surveyed_lot(truth: &Value) -> (Place, CameraEstimate, String) {
    let camera = &truth["camera"];
    let size = ImageSize::from([1280, 720]);
    let camera = CameraEstimate {
        span_s: [0.0, 5.0],
        image_size_px: size,
        principal_point_px: size.centre_px(),
        lens: roadplane_base::Lens::STRAIGHT,
        distortion_sd: None,
        params: CameraParams {
            log_focal: number(&camera["focal_px"]).ln(),
            tilt: number(&camera["tilt_rad"]),
            roll: number(&camera["roll_rad"]),
            log_height: number(&camera["height_m"]).ln(),
        },
        covariance: Matrix4::identity() * 1e-8,
        status: CameraStatus::Estimated,
        cars_used: 0,
        frames_used: 0,
        second_plane: None,
    };
    let place = Place::from_camera(&camera, [51.05, 13.74], 130.0).unwrap();
    let line = |pixel: [f64; 2]| {
        let (at, _) = place.utm_from_pixel(pixel).unwrap();
        let [latitude, longitude] = place.zone.to_degrees([at.x, at.y]).unwrap();
        format!("{},{},{latitude:.9},{longitude:.9}\n", pixel[0], pixel[1])
    };
    let lines = [[100.0, 650.0], [1200.0, 600.0], [200.0, 180.0], [1100.0, 150.0]].map(line);
    (place, camera, format!("x_px,y_px,latitude,longitude\n{}", lines.concat()))
}

#[test]
fn a_run_with_surveyed_points_has_tracks_on_the_map() {
    let dir = tempfile::tempdir().unwrap();
    let truth = json(&root().join("tests/data/lot.truth.json"));
    let (place, camera, points) = surveyed_lot(&truth);
    let file = dir.path().join("points.csv");
    std::fs::write(&file, points).unwrap();
    let run = |option: &str, value: &std::ffi::OsStr| {
        let mut command = roadplane();
        command.arg("run").arg(root().join("tests/data/lot.mp4")).arg("--out").arg(dir.path());
        command.args(["--set", "decode.stride=3", option]).arg(value).assert()
    };
    run("--camera-at", "51.05,13.74".as_ref()).code(2);
    run("--geo", file.as_os_str()).code(0);
    let result = dir.path().join("lot");
    // The surveyed points determine the camera more precisely than the cars do.
    let fit = json(&result.join("place.json"));
    assert!((number(&fit["focal_px"]) / camera.params.focal_px() - 1.0).abs() < 0.01, "{fit}");
    assert_eq!(fit["zone"], "33N");
    let found = json(&result.join("camera.json"));
    assert!((number(&found["focal_px"]) - number(&fit["focal_px"])).abs() < 1e-2);

    let mut errors = Vec::new();
    for row in json_lines(&result.join("tracks.jsonl")) {
        let frame = truth["frames"].as_array().unwrap().iter().find(|frame| frame["frame"] == row["frame"]);
        let errors_m = frame.unwrap()["cars"].as_array().unwrap().iter().map(|car| {
            let motion = &car["world_from_car"];
            let pose =
                GroundPose { x_m: number(&motion[0][3]), y_m: number(&motion[1][3]), heading_rad: 0.0 };
            let at = place.on_map(&pose, [0.0; 2], &camera).unwrap();
            (at.east_m - number(&row["east_m"])).hypot(at.north_m - number(&row["north_m"]))
        });
        errors.push(errors_m.fold(f64::INFINITY, f64::min));
    }
    errors.sort_by(f64::total_cmp);
    let median = errors[errors.len() / 2];
    println!("on the map: median {median:.2} m of {} rows", errors.len());
    assert!(errors.len() > 100 && median < 0.4, "{median}");

    // The file tracks.geojson has the same positions. An export reads the map position from the run, so it does not
    // need the points.
    let lines = json(&result.join("tracks.geojson"));
    let out = dir.path().join("out");
    roadplane().arg("export").arg(&result).args(["--format", "geojson", "--out"]).arg(&out).assert().code(0);
    let exported = json(&out.join("geojson/lot.tracks.geojson"));
    assert_eq!(lines["features"], exported["features"]);
    let [longitude, latitude] =
        [0, 1].map(|i| number(&lines["features"][0]["geometry"]["coordinates"][0][i]));
    assert!((latitude - 51.05).abs() < 1e-3 && (longitude - 13.74).abs() < 1e-3);
    let twice = roadplane()
        .arg("export")
        .arg(&result)
        .args(["--format", "csv", "--camera-at", "51.05,13.74,130", "--out"])
        .arg(&out)
        .output();
    assert_eq!(twice.unwrap().status.code(), Some(2));

    // A format whose data is missing is left out, with the reason, and the others are written.
    std::fs::remove_file(result.join("activities.jsonl")).unwrap();
    let all = dir.path().join("all");
    let mut export = roadplane();
    let done =
        export.arg("export").arg(&result).args(["--format", "all", "--out"]).arg(&all).output().unwrap();
    let log = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(0), "{log}");
    assert!(log.contains("left out: the format actev needs activities"), "{log}");
    assert!(log.contains("left out: this command cannot write rerun"), "{log}");
    let mut expected = FORMATS.iter().map(|format| format.name).filter(|name| *name != "actev");
    assert!(expected.all(|name| all.join(name).is_dir()), "{:?}", names(&all));
    assert!(!all.join("actev").exists());
}

/// Returns the five surveyed points of `road_survey.mp4`: pixel x and y, and east and north in UTM zone 32. The README
/// of the clips describes the survey.
fn survey() -> Vec<[f64; 4]> {
    let table = include_str!("data/road_survey.csv");
    let point = |line: &str| -> [f64; 4] {
        let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
        numbers.try_into().unwrap()
    };
    table.lines().skip(1).map(point).collect()
}

/// Three of five surveyed points give the map position of the camera, and the other two points are predicted. The test
/// does this for all ten choices.
#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn surveyed_points_that_were_not_given_are_predicted_within_their_sds() {
    let clip = shared("clips/road_survey.mp4");
    let dir = tempfile::tempdir().unwrap();
    roadplane().arg("run").arg(clip).arg("--out").arg(dir.path()).assert().success();
    let run = Run::read(&dir.path().join("road_survey")).unwrap();
    let camera = &run.segments[0].camera.estimate();
    let zone = UtmZone::numbered(32, false).unwrap();
    let points: Vec<SurveyPoint> = survey()
        .into_iter()
        .map(|[x, y, east, north]| {
            let [latitude, longitude] = zone.to_degrees([east, north]).unwrap();
            SurveyPoint { pixel: [x, y], latitude, longitude, height_m: 0.0, frame: None }
        })
        .collect();
    let (mut squares, mut within) = (Vec::new(), 0);
    for (a, b) in (0..5).flat_map(|a| (a + 1..5).map(move |b| (a, b))) {
        let given: Vec<SurveyPoint> = (0..5).filter(|i| *i != a && *i != b).map(|i| points[i]).collect();
        let place = Place::from_points(camera, &given).unwrap();
        for i in [a, b] {
            let (at, covariance) = place.utm_from_pixel(points[i].pixel).unwrap();
            let truth = place.zone.from_degrees(points[i].latitude, points[i].longitude).unwrap();
            let square = (at.x - truth[0]).powi(2) + (at.y - truth[1]).powi(2);
            within += usize::from(square <= 4.0 * covariance.trace());
            squares.push(square);
        }
    }
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    println!("road_survey: {rms:.2} m rms over {} predictions, {within} within 2 sd", squares.len());
    assert!(within >= 19 && rms < 1.0, "{rms} {within}");
    let all = Place::from_points(camera, &points).unwrap().fit;
    println!(
        "all five: focal {:.0} ± {:.0} px, height {:.2} ± {:.2} m",
        all.focal_px, all.focal_sd_px, all.height_m, all.height_sd_m
    );
    // Other people evaluated the survey alone, and found 613 ± 18 px and 3.95 m.
    assert!((all.focal_px - 613.0).abs() < 2.0 * 18.0 && (all.height_m - 3.95).abs() < 0.2);
}

#[test]
fn surveyed_points_that_contradict_the_camera_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let few = ["--set", "decode.max_frames=60"];
    let piece = roadplane()
        .args(["run", "tests/data/lot.mp4", "--piece", "0-", "--out"])
        .arg(at("p"))
        .args(few)
        .assert();
    piece.code(0);
    let join = |out: &str, points: &[&str]| {
        let mut command = roadplane();
        command.arg("join").arg(at("p/lot.piece-000000")).arg("--out").arg(at(out)).args(few);
        if !points.is_empty() {
            let file = at("points.csv");
            std::fs::write(&file, points.join("\n")).unwrap();
            command.arg("--geo").arg(file);
        }
        command.assert()
    };
    join("plain", &[]).code(0);
    // These are the points of the book's chapter on the map, with latitude and longitude swapped.
    let swapped = [
        "197,397,13.7403077,51.0499307",
        "457,222,13.7404137,51.0498413",
        "799,499,13.7401678,51.0498895",
        "864,257,13.7402776,51.0497994",
    ];
    join("swapped", &swapped).code(3);
    for file in ["camera.json", "tracks.csv", "poses.jsonl"] {
        let read = |run: &str| std::fs::read(at(run).join("lot").join(file)).unwrap();
        assert!(read("plain") == read("swapped"), "{file}");
    }
    let result = at("swapped/lot");
    assert!(!result.join("place.json").exists() && !result.join("tracks.geojson").exists());
    let summary = json(&result.join("summary.json"));
    assert_eq!((&summary["status"], &summary["exit_code"]), (&"points_not_used".into(), &3.into()));
    let warnings = summary["warnings"].to_string();
    assert!(warnings.contains("probably latitude and longitude are swapped"), "{warnings}");
    let right = swapped.map(|line| {
        let [x, y, longitude, latitude] = line.split(',').collect::<Vec<_>>()[..] else {
            panic!("four fields")
        };
        format!("{x},{y},{latitude},{longitude}")
    });
    join("right", &right.each_ref().map(String::as_str)).code(0);
    assert!(at("right/lot/place.json").exists());
}
