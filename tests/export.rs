//! `roadplane export`: what it refuses. What it writes is tested in its crate.

use roadplane_export::{Place, Run, SurveyPoint, UtmZone};

use crate::common::{names, roadplane, shared};

#[test]
fn formats_are_listed_and_unknown_ones_refused() {
    let list = roadplane().args(["export", "--format", "list"]).output().unwrap();
    let text = String::from_utf8(list.stdout).unwrap();
    assert!(list.status.success());
    for name in ["mot", "kitti", "kpf", "actev", "geojson", "sumo-fcd", "ngsim", "highd", "rerun"] {
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
    assert_eq!(failed.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&failed.stderr).contains("summary.json"));
    assert_eq!(names(dir.path()), Vec::<String>::new());
}

/// Five surveyed points of `road_survey.mp4`: pixel, east and north in UTM zone 32 (see the README of the clips).
const SURVEY: [[f64; 4]; 5] = [
    [14.0, 259.0, 844_098.58, 5_673_186.10],
    [652.0, 136.0, 844_079.00, 5_673_195.83],
    [641.0, 297.0, 844_095.60, 5_673_198.49],
    [305.0, 129.0, 844_080.05, 5_673_179.59],
    [353.0, 192.0, 844_091.24, 5_673_189.84],
];

/// Three points place the camera, the other two are predicted, in all ten ways.
#[test]
fn surveyed_points_that_were_not_given_are_predicted_within_their_sds() {
    let Some(clip) = shared("clips/road_survey.mp4") else { return };
    let dir = tempfile::tempdir().unwrap();
    roadplane().arg("run").arg(clip).arg("--out").arg(dir.path()).assert().success();
    let run = Run::read(&dir.path().join("road_survey")).unwrap();
    let camera = &run.stretches[0].camera;
    let zone = UtmZone::numbered(32, false).unwrap();
    let points: Vec<SurveyPoint> = SURVEY
        .iter()
        .map(|&[x, y, east, north]| {
            let [latitude, longitude] = zone.to_degrees([east, north]).unwrap();
            SurveyPoint { pixel: [x, y], latitude, longitude, height_m: 0.0 }
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
    // The survey alone, by others: 613 ± 18 px, 3.95 m.
    assert!((all.focal_px - 613.0).abs() < 2.0 * 18.0 && (all.height_m - 3.95).abs() < 0.2);
}
