//! Tests that each constraint becomes the right factor, or an error with a reason.

use std::path::{Path, PathBuf};

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraEstimate, CameraParams, CameraStatus, GroundPlane, Homography};
use roadplane_calibrate::FuseOptions;
use roadplane_write::write_camera;

use super::*;

/// Size of the test pictures, px.
const SIZE: ImageSize = ImageSize { width: 1920, height: 1080 };

/// Parses a number with an optional sd.
fn measured(text: &str) -> Option<Measured> {
    Some(text.parse().unwrap())
}

/// Returns the factors of the options for the first camera position.
fn factors(options: &ConstraintOptions<'_>) -> Vec<Factor> {
    CameraConstraints::new(options).unwrap().for_pictures(SIZE).unwrap().factors(0, SIZE)
}

/// Returns the usage error of the options.
fn refused(options: &ConstraintOptions<'_>) -> String {
    let error = CameraConstraints::new(options).unwrap_err();
    assert!(matches!(error, PipelineError::Usage { .. }), "{error:?}");
    error.to_string()
}

/// Writes a file and returns its path.
fn file(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn numbers_become_factors_in_logs_and_radians() {
    let exact = CameraConstraints::new(&ConstraintOptions {
        focal_px: measured("1500"),
        ..ConstraintOptions::default()
    })
    .unwrap();
    assert_eq!(exact, CameraConstraints::focal(Some(1500.0)));
    assert!(exact.is_silent());
    let options = ConstraintOptions {
        focal_px: measured("1500±60"),
        tilt_deg: measured("20"),
        roll_deg: measured("-1±0.5"),
        height_m: measured("7.5"),
        ..ConstraintOptions::default()
    };
    let expected = [
        (0, 1500_f64.ln(), 0.04),
        (1, 20_f64.to_radians(), 2_f64.to_radians()),
        (2, -1_f64.to_radians(), 0.5_f64.to_radians()),
        (3, 7.5_f64.ln(), 0.05),
    ];
    let expected: Vec<Factor> = expected
        .into_iter()
        .map(|(which, value, sd)| Factor::Survey(Survey::of_number(which, value, sd)))
        .collect();
    assert_eq!(factors(&options), expected);
    let known = CameraConstraints::new(&options).unwrap();
    assert_eq!(known.focal_px(), None);
    // After a move the camera has the same height and lens, but other angles.
    assert_eq!(known.factors(1, SIZE), [expected[0].clone(), expected[3].clone()]);
    assert!(known.silent_later().is_some_and(|text| text.contains("first position")));
}

#[test]
fn what_makes_no_sense_is_refused() {
    let focal = |text| ConstraintOptions { focal_px: measured(text), ..ConstraintOptions::default() };
    assert!(refused(&focal("-1500")).contains("--focal-px"));
    assert!(refused(&focal("0±3")).contains("--focal-px"));
    let options = ConstraintOptions { tilt_deg: measured("90"), ..ConstraintOptions::default() };
    assert!(refused(&options).contains("--tilt-deg"));
    let options = ConstraintOptions { height_m: measured("0"), ..ConstraintOptions::default() };
    assert!(refused(&options).contains("--height-m"));
}

#[test]
fn lengths_are_measured_from_the_middle_and_must_lie_in_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path =
        file(folder.path(), "bays.csv", "x1,y1,x2,y2,length_m,sd_m\n959.5,539.5,1059.5,639.5,2.5,0.05\n");
    let options = ConstraintOptions { lengths: Some(&path), ..ConstraintOptions::default() };
    let expected = Factor::Length(Length {
        ends_px: [Vector2::zeros(), Vector2::new(100.0, 100.0)],
        end_sd_px: 1.0,
        length_m: 2.5,
        log_sd: 0.02,
    });
    assert_eq!(factors(&options), [expected]);
    let small = ImageSize { width: 640, height: 360 };
    let error = CameraConstraints::new(&options).unwrap().for_pictures(small).unwrap_err().to_string();
    assert!(
        error.contains("the length \"line 2\" ends outside the picture") && error.ends_with("bays.csv"),
        "{error}"
    );
    let broken = file(folder.path(), "broken.csv", "a,b\n1,2\n");
    assert!(refused(&ConstraintOptions { lengths: Some(&broken), ..options }).contains("broken.csv"));
    let missing = folder.path().join("missing.csv");
    let error =
        CameraConstraints::new(&ConstraintOptions { lengths: Some(&missing), ..options }).unwrap_err();
    assert!(matches!(error, PipelineError::Write(WriteError::Io { .. })), "{error:?}");
}

#[test]
fn lengths_of_a_frame_are_put_into_the_first_picture() {
    let folder = tempfile::tempdir().unwrap();
    let table = "x1,y1,x2,y2,length_m,sd_m,frame\n959.5,539.5,1059.5,639.5,2.5,0.05,7\n1,2,3,4,2.5,0.05,8\n";
    let path = file(folder.path(), "bays.csv", table);
    let options = ConstraintOptions { lengths: Some(&path), ..ConstraintOptions::default() };
    let known = CameraConstraints::new(&options).unwrap();
    // The first picture shows the scene at half the size, shifted.
    let view = Homography::from_numbers([0.5, 0.0, 500.0, 0.0, 0.5, 300.0, 0.0, 0.0]).unwrap();
    let (known, left_out) = known.with_frames(&[(7, view.into())].into());
    assert_eq!(left_out, 1);
    let corner = Vector2::new(0.5 * 959.5 + 500.0, 0.5 * 539.5 + 300.0) - SIZE.centre_px();
    let expected = Factor::Length(Length {
        ends_px: [corner, corner + Vector2::new(50.0, 50.0)],
        end_sd_px: 0.5,
        length_m: 2.5,
        log_sd: 0.02,
    });
    assert_eq!(known.for_pictures(SIZE).unwrap().factors(0, SIZE), [expected]);
}

#[test]
fn cameras_of_other_programs_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let opencv = "%YAML:1.0\n---\nimage_width: 960\nimage_height: 540\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   \
                  dt: d\n   data: [ 800., 0., 479.5, 0.,\n       800., 2.695e+02, 0., 0., 1. ]\n\
                  distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 2\n   dt: d\n   data: [ -0.3, 0.1 ]\n";
    let path = file(folder.path(), "lens.yml", opencv);
    let options = ConstraintOptions { camera: Some(&path), ..ConstraintOptions::default() };
    let known = CameraConstraints::new(&options).unwrap();
    assert_eq!(known.focal_px(), Some(800.0));
    // Pictures of twice the size have twice the focal length. Pictures of another shape belong to another camera.
    assert!((known.for_pictures(SIZE).unwrap().focal_px().unwrap() - 1600.0).abs() < 1e-9);
    let twice = known.for_pictures(SIZE).unwrap().for_pictures(SIZE).unwrap();
    assert!((twice.focal_px().unwrap() - 1600.0).abs() < 1e-9);
    let error = known.for_pictures(ImageSize { width: 1280, height: 960 }).unwrap_err().to_string();
    assert!(error.contains("960 × 540"), "{error}");
    let ros =
        file(folder.path(), "ros.yaml", "camera_matrix:\n  data: [900, 0, 320, 0, 900, 240, 0, 0, 1]\n");
    let options = ConstraintOptions { camera: Some(&ros), ..options };
    assert_eq!(CameraConstraints::new(&options).unwrap().focal_px(), Some(900.0));
    let twice = ConstraintOptions { focal_px: measured("900"), ..options };
    assert!(refused(&twice).contains("given twice"));
    for (name, text, words) in [
        ("a.yml", "camera_matrix: [1, 2]", "nine numbers"),
        ("b.yml", "camera_matrix: {data: [-1, 0, 1, 0, 1, 1, 0, 0, 1]}", "no matrix of a pinhole"),
        ("c.yml", "a: [", "c.yml"),
        ("d.yml", "", "d.yml"),
        ("e.txt", "", "must end in"),
        ("f.json", "{}", "f.json"),
        ("g.krtd", "1 2 3", "21 numbers"),
    ] {
        let path = file(folder.path(), name, text);
        let error = refused(&ConstraintOptions { camera: Some(&path), ..options });
        assert!(error.contains(words), "{error}");
    }
    let plane = GroundPlane::from_tilt_roll_height(0.3, 0.01, 10.0);
    let m = plane.camera_from_world().to_homogeneous();
    let rows: Vec<String> = (0..3).map(|r| format!("{} {} {}", m[(r, 0)], m[(r, 1)], m[(r, 2)])).collect();
    let text = format!(
        "1500 0 960\n0 1500 540\n0 0 1\n{}\n{} {} {}\n",
        rows.join("\n"),
        m[(0, 3)],
        m[(1, 3)],
        m[(2, 3)]
    );
    let path = file(folder.path(), "a.krtd", &text);
    let known = CameraConstraints::new(&ConstraintOptions { camera: Some(&path), ..options }).unwrap();
    assert_eq!(known.focal_px(), Some(1500.0));
    let [Factor::Survey(Survey { mean, information, by_cars: false })] = known.factors(0, SIZE)[..] else {
        panic!("no camera")
    };
    assert!((mean - Vector4::new(1500_f64.ln(), 0.3, 0.01, 10_f64.ln())).norm() < 1e-9);
    assert!(information[(0, 0)] == 0.0 && (information[(3, 3)] - 400.0).abs() < 1e-6);
}

#[test]
fn our_own_cameras_come_with_their_covariance() {
    let folder = tempfile::tempdir().unwrap();
    let read = |height_sd: f64, status: CameraStatus| {
        let mut covariance = Matrix4::from_diagonal(&Vector4::new(4e-4, 1e-4, 1e-4, height_sd * height_sd));
        (covariance[(0, 3)], covariance[(3, 0)]) = (1e-4, 1e-4);
        let estimate = CameraEstimate {
            params: CameraParams { log_focal: 7.0, tilt: 0.3, roll: 0.0, log_height: 2.0 },
            covariance,
            status,
            ..FuseOptions::for_image(SIZE).unobservable([0.0, 1.0])
        };
        let path = folder.path().join("camera.json");
        write_camera(&path, &[estimate], Vec::new()).unwrap();
        CameraConstraints::new(&ConstraintOptions { camera: Some(&path), ..ConstraintOptions::default() })
    };
    // One height includes the uncertainty of the cars' size, the other was measured.
    for (height_sd, expected_sd, expected_by_cars) in [(0.05, 0.03, true), (0.02, 0.02, false)] {
        let known = read(height_sd, CameraStatus::Estimated).unwrap();
        let [Factor::Survey(Survey { mean, information, by_cars })] = known.factors(0, SIZE)[..] else {
            panic!("no camera")
        };
        assert!((mean - Vector4::new(7.0, 0.3, 0.0, 2.0)).norm() < 1e-4 && by_cars == expected_by_cars);
        let covariance = information.try_inverse().unwrap();
        assert!(
            (covariance[(3, 3)].sqrt() - expected_sd).abs() < 1e-4
                && (covariance[(0, 3)] - 1e-4).abs() < 1e-6
        );
    }
    assert!(
        read(0.05, CameraStatus::Unobservable).unwrap_err().to_string().contains("could not be estimated")
    );
}

#[test]
fn contradictions_are_found_by_all_other_evidence() {
    let options = ConstraintOptions {
        focal_px: measured("1500±30"),
        height_m: measured("8±0.1"),
        ..ConstraintOptions::default()
    };
    let known = CameraConstraints::new(&options).unwrap();
    let all_else = CameraEstimate {
        params: CameraParams { log_focal: 1000_f64.ln(), tilt: 0.3, roll: 0.0, log_height: 8.1_f64.ln() },
        covariance: Matrix4::from_diagonal(&Vector4::new(4e-4, 1e-4, 1e-4, 1.6e-3)),
        status: CameraStatus::Estimated,
        ..FuseOptions::for_image(SIZE).unobservable([0.0, 1.0])
    };
    let (checked, _) = known.checked(SIZE, |others| {
        assert_eq!(others.facts.len(), 1);
        [(0, all_else.clone())].into()
    });
    let told: Vec<Option<String>> = checked.iter().map(contradiction).collect();
    let text = "the focal length is 1000 ± 20 px by everything else, but 1500 ± 30 px was given: 14 sd apart";
    assert_eq!(told, [Some(text.to_owned()), None]);
    assert!(checked[1].apart_sds < 1.0, "{checked:?}");
}

#[test]
fn a_constraint_is_compared_at_a_position_for_which_it_holds() {
    let options = ConstraintOptions {
        tilt_deg: measured("20"),
        height_m: measured("8±0.1"),
        ..ConstraintOptions::default()
    };
    let known = CameraConstraints::new(&options).unwrap();
    let estimate = FuseOptions::for_image(SIZE).unobservable([0.0, 1.0]);
    let names = |position: usize| -> (Vec<String>, usize) {
        let (checked, not_compared) = known.checked(SIZE, |_| [(position, estimate.clone())].into());
        (checked.into_iter().map(|known| known.what).collect(), not_compared)
    };
    assert_eq!(names(0), (vec!["tilt".to_owned(), "height".to_owned()], 0));
    assert_eq!(names(1), (vec!["height".to_owned()], 1), "the tilt holds for the first position only");
    assert!(not_compared_in_words(0).is_none() && not_compared_in_words(1).is_some());
}

#[test]
fn a_height_by_cars_is_as_uncertain_as_their_size() {
    let estimate = FuseOptions::for_image(SIZE).unobservable([0.0, 1.0]);
    let given_sd = |by_cars: bool| {
        let variance = Vector4::repeat(1e-4);
        let survey = Survey {
            mean: estimate.params.to_vector(),
            information: Matrix4::from_diagonal(&variance.map(f64::recip)),
            by_cars,
        };
        let fact = Fact::Camera { file: "camera.json".to_owned(), size: None, survey };
        let known = CameraConstraints { facts: vec![fact], ..CameraConstraints::default() };
        let (checked, _) = known.checked(SIZE, |_| [(0, estimate.clone())].into());
        let height = checked.iter().find(|known| known.what.starts_with("height")).unwrap();
        height.given_sd / height.given
    };
    assert!((given_sd(false) - 0.01).abs() < 1e-4);
    assert!((given_sd(true) - 0.01_f64.hypot(0.04)).abs() < 1e-4);
}
