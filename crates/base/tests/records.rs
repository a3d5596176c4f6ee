//! Records survive writing and reading, older files are read, and impossible values are rejected by name.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Matrix4, UnitQuaternion, Vector2, Vector3};
use roadplane_base::{
    CameraEstimate, CameraEvidence, CameraMove, CameraParams, CameraPrior, CameraStatus, CarRecord, CarRef,
    ClipIdentity, EVIDENCE_SCHEMA, Frame, FrameRecord, FrameStamp, ImageSize, KEYPOINTS, Lens, MoveKind,
    ParkedCar, PictureVerdict, RecordError, RegisteredLens, Registration, SceneCurve, SceneLine, TrackRow,
    VehicleClass, WatchRecord, WeakBox, rows_from_isometry,
};
use serde_json::{Value, json};

const SIZE: ImageSize = ImageSize { width: 640, height: 360 };

/// Returns a frame with scene edges, a turned camera and two vehicles, one of them carried over from an earlier frame.
fn frame() -> FrameRecord {
    let line = [10.0, 20.0, 10.5, 80.0, 0.01];
    let curve = [0.0, 5.0, 300.0, 2.5, 600.0, 5.0, 0.25];
    let carried_over = CarRecord {
        class: VehicleClass::Truck,
        held_since: Some(3),
        pose_from: Some(CarRef { frame: 3, car: 1 }),
        seen_after: Some(CarRef { frame: 2, car: 0 }),
        ..CarRecord::boxed([50.0, 60.0, 90.0, 80.0])
    };
    let watch = WatchRecord {
        looked: true,
        verdict: PictureVerdict::Rest,
        offset_px: [0.5, -0.25],
        moved: Some(CameraMove {
            kind: MoveKind::Turned,
            since_frame: 4,
            since_s: 0.16,
            shift_px: Some([12.0, 1.0]),
            log_scale: None,
        }),
        changed: Some(0.125),
        seen: None,
        left_out: None,
        motion: vec![Registration {
            reference: 2,
            homography: Some([1.0, 0.01, 3.5, -0.01, 1.0, -2.0, 1e-5, 0.0]),
            sd_px: 0.2,
            lens: Some(RegisteredLens {
                bend: -0.02,
                sd: 0.003,
                change: [0.5, 0.0, -40.0, 0.0, 0.5, 3.0, 1e-4, 0.0],
            }),
        }],
        place: None,
        picture_from_world: None,
    };
    FrameRecord {
        watch: Some(watch),
        scene_lines: Some(vec![line.into()]),
        scene_curves: Some(vec![curve.into()]),
        cars: vec![
            CarRecord { colour_rgb: Some([120, 0, 255]), ..CarRecord::boxed([1.0, 2.0, 31.0, 22.0]) },
            carried_over,
        ],
        weak: vec![WeakBox { bbox_px: [51.0, 2.0, 81.0, 22.0], score: 0.2, colour_rgb: Some([1, 2, 3]) }],
        ..FrameRecord::empty(7, 0.28, SIZE)
    }
}

#[test]
fn a_frame_with_all_fields_survives() {
    let text = serde_json::to_string(&frame()).unwrap();
    assert_eq!(FrameRecord::from_json(&text).unwrap(), frame());
    // The file contains lists of numbers, as documented.
    let value: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(value["image_size_px"], json!([640, 360]));
    assert_eq!(value["scene_lines"][0], json!([10.0, 20.0, 10.5, 80.0, 0.01]));
    assert_eq!(value["scene_curves"][0][6], json!(0.25));
    assert_eq!(value["cars"][0]["colour_rgb"], json!([120, 0, 255]));
    assert_eq!(value["cars"][1]["pose_from"], json!([3, 1]));
    assert_eq!(value["watch"]["moved"]["kind"], json!("turned"));
    assert_eq!(frame().cars[1].longer_side_px(), 40.0);
    assert_eq!(frame().watch.unwrap().offset(), Vector2::new(0.5, -0.25));
}

#[test]
fn impossible_frames_are_rejected_by_field() {
    let nulls = |count: usize| vec![Value::Null; count];
    for (field, wrong, words) in [
        ("/image_size_px", json!([0, 360]), "image_size_px"),
        ("/scene_lines/0", json!([1.0, 2.0, 1.0, 2.0, 0.01]), "scene_lines[0]"),
        ("/cars/0/bbox_px", json!([31.0, 2.0, 1.0, 22.0]), "cars[0].bbox_px"),
        ("/cars/0/class", json!("tram"), "tram"),
        ("/cars/1/keypoints", json!(nulls(KEYPOINTS - 1)), "keypoints has 35 entries"),
        ("/cars/1/keypoint_covariances_px2", json!(nulls(KEYPOINTS + 1)), "keypoint_covariances_px2 has 37"),
    ] {
        let mut value = serde_json::to_value(frame()).unwrap();
        value["cars"][1]["keypoints"] = json!(nulls(KEYPOINTS));
        value["cars"][1]["keypoint_covariances_px2"] = json!(nulls(KEYPOINTS));
        assert!(FrameRecord::from_json(&value.to_string()).is_ok());
        *value.pointer_mut(field).unwrap() = wrong;
        let error = FrameRecord::from_json(&value.to_string()).unwrap_err().to_string();
        assert!(error.contains(words), "{field}: {error}");
    }
}

#[test]
fn rounding_edges_loses_no_accuracy() {
    let line = SceneLine::from([10.123_456, 20.0, 11.0, 80.987_654, 0.001_234_567]);
    let kept = line.rounded();
    assert!(kept.ends_px.iter().zip(line.ends_px).all(|(a, b)| (a - b).norm() < 0.01));
    assert_eq!((kept.rounded(), kept.sd_rad), (kept, 0.00123));
    let curve = SceneCurve::from([0.004, 5.0, 300.0, 2.5, 600.0, 5.0, 0.254]);
    assert_eq!(<[f64; 7]>::from(curve.rounded()), [0.0, 5.0, 300.0, 2.5, 600.0, 5.0, 0.25]);
    // A very small sd is not rounded to zero.
    assert!(SceneLine { sd_rad: 1e-9, ..line }.rounded().is_sound());
    assert!(SceneCurve { sd_px: 1e-9, ..curve }.rounded().is_sound());
}

#[test]
fn edges_without_length_or_sd_are_not_sound() {
    let line = SceneLine::from([10.0, 20.0, 11.0, 80.0, 0.01]);
    let curve = SceneCurve::from([0.0, 5.0, 300.0, 2.5, 600.0, 5.0, 0.25]);
    assert!(line.is_sound() && curve.is_sound());
    assert_eq!((line.middle_px(), line.along_px()), (Vector2::new(10.5, 50.0), Vector2::new(1.0, 60.0)));
    let point = Vector2::new(3.0, 4.0);
    assert!(!SceneLine { ends_px: [point, point], ..line }.is_sound());
    assert!(!SceneCurve { points_px: [point, Vector2::new(9.0, 9.0), point], ..curve }.is_sound());
    for sd in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(
            !SceneLine { sd_rad: sd, ..line }.is_sound() && !SceneCurve { sd_px: sd, ..curve }.is_sound()
        );
    }
}

/// Returns the evidence of a clip with one parked car.
fn evidence() -> CameraEvidence {
    CameraEvidence {
        schema: EVIDENCE_SCHEMA.to_owned(),
        camera: "gate-3".to_owned(),
        clip: ClipIdentity {
            recorded: "2026-01-31T22:00:00".to_owned(),
            sha256: "ab".to_owned(),
            name: "night".to_owned(),
        },
        models: vec!["detector abc".to_owned()],
        image_size_px: SIZE,
        span_s: [0.0, 60.0],
        frames: 1500,
        params: [7.0, 0.3, 0.0, 2.0],
        information: std::array::from_fn(|r| {
            std::array::from_fn(|c| if r == c { 100.0 } else { f64::from(u8::try_from(r + c).unwrap()) })
        }),
        shared: [[1.0, 2.0, 3.0, 4.0, 5.0]; 4],
        lens: Some((Lens { per_px2: -1e-7 }, 1e-8)),
        parked: vec![ParkedCar {
            bbox_px: [1.0, 2.0, 30.0, 40.0],
            keypoints_px: vec![Some([5.0, 6.0]); KEYPOINTS],
        }],
        moving: 3,
        place: None,
    }
}

#[test]
fn the_mean_of_evidence_is_its_camera() {
    assert!(evidence().check().is_ok());
    let joint = evidence().joint();
    let mean = joint.information.try_inverse().unwrap() * joint.vector;
    assert!((mean - evidence().camera_params().to_vector()).amax() < 1e-9, "{mean}");
    assert_eq!((joint.cross[(2, 4)], joint.information[(1, 3)]), (5.0, 4.0));
}

#[test]
fn evidence_of_older_versions_is_read() {
    let older = |shared: Value| {
        let mut value = serde_json::to_value(evidence()).unwrap();
        let fields = value.as_object_mut().unwrap();
        fields.remove("lens");
        if shared.is_null() {
            fields.remove("shared")
        } else {
            fields.insert("shared".to_owned(), shared)
        };
        serde_json::from_value::<CameraEvidence>(value)
    };
    let before = older(Value::Null).unwrap();
    assert_eq!((before.shared, before.lens), ([[0.0; 5]; 4], None));
    assert_eq!(older(json!([[1.5, 2.5], [], [3.5], []])).unwrap().shared[0], [1.5, 2.5, 0.0, 0.0, 0.0]);
    let error = older(json!([[1, 2, 3, 4, 5, 6], [], [], []])).unwrap_err().to_string();
    assert!(error.contains("more than 5 errors"), "{error}");
}

#[test]
fn impossible_evidence_is_rejected() {
    type Spoil = fn(&mut CameraEvidence);
    let spoilt: [(Spoil, &str); 8] = [
        (|e| e.schema = "roadplane.evidence/9".to_owned(), "roadplane.evidence/9"),
        (|e| e.params[0] = f64::NAN, "not finite"),
        (|e| e.span_s[1] = f64::INFINITY, "not finite"),
        (|e| e.lens = Some((Lens::STRAIGHT, f64::NAN)), "not finite"),
        (|e| e.parked[0].keypoints_px[9] = Some([f64::NAN, 1.0]), "not finite"),
        (|e| e.information[0][1] += 1.0, "symmetric"),
        (|e| e.information[2][2] = -1.0, "positive diagonal"),
        (|e| e.parked[0].keypoints_px.truncate(9), "36 keypoints"),
    ];
    for (spoil, words) in spoilt {
        let mut wrong = evidence();
        spoil(&mut wrong);
        let error = wrong.check().unwrap_err();
        assert!(
            matches!(&error, RecordError::Unsuitable { what } if what.contains(words)),
            "{words}: {error}"
        );
    }
}

#[test]
fn rows_of_older_versions_are_read() {
    let row: TrackRow = serde_json::from_value(json!({
        "frame": 1, "time_s": 0.04, "track": 2, "x_m": 3.0, "y_m": 20.0, "heading_rad": FRAC_PI_2, "speed_mps": -1.0,
        "x_sd_m": 0.1, "y_sd_m": 0.2, "heading_sd_rad": 0.01, "length_m": 4.5, "width_m": 1.8, "height_m": 1.5,
        "bbox_px": [1.0, 2.0, 30.0, 40.0], "score": 0.9, "observed": true,
    }))
    .unwrap();
    assert_eq!((row.class, row.segment, row.speed_sd_mps), (VehicleClass::Car, 0, 0.0));
    assert!(row.activity.is_none() && row.on_map.is_none());
    assert_eq!((row.pose().x_m, row.pose().y_m, row.pose().heading_rad), (3.0, 20.0, FRAC_PI_2));
}

#[test]
fn names_in_files_are_those_in_the_code() {
    for class in VehicleClass::ALL {
        assert_eq!(serde_json::to_value(class).unwrap(), json!(class.name()));
    }
    let blind = [PictureVerdict::Black, PictureVerdict::White, PictureVerdict::Covered];
    assert!(blind.iter().all(|verdict| verdict.is_blind()) && !PictureVerdict::Frozen.is_blind());
}

#[test]
fn a_frame_returns_its_time_and_size() {
    let stamp = FrameStamp { index: 3, pts_nanos: 120_000_000 };
    let frame = Frame { stamp, image: image::RgbImage::new(640, 360) };
    assert!((frame.stamp.time_s() - 0.12).abs() < 1e-12);
    assert_eq!((frame.size(), frame.bytes()), (SIZE, 640 * 360 * 3));
    // The centre lies between the two middle pixels of each axis, because (0, 0) is the centre of a pixel.
    assert_eq!(SIZE.centre_px(), Vector2::new(319.5, 179.5));
}

#[test]
fn rows_of_a_motion_move_points() {
    let motion = Isometry3::from_parts(
        Vector3::new(1.0, 2.0, 3.0).into(),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2),
    );
    let matrix = Matrix4::from_fn(|r, c| rows_from_isometry(&motion)[r][c]);
    let moved = matrix * Vector3::new(4.0, 0.0, 0.0).push(1.0);
    assert!((moved - Vector3::new(1.0, 6.0, 3.0).push(1.0)).norm() < 1e-12);
}

#[test]
fn a_prior_follows_the_longer_side_and_none_has_no_information() {
    let prior = CameraPrior::default();
    let [wide, tall] = [[640, 360], [360, 640]].map(|size| prior.mean(ImageSize::from(size)));
    assert_eq!(wide, tall);
    assert!((wide.focal_px() - 1.2 * 640.0).abs() < 1e-9 && (wide.log_height - 7_f64.ln()).abs() < 1e-12);
    assert!((prior.information()[0] - 1.0 / 0.36).abs() < 1e-12);
    assert_eq!(CameraPrior::none().information().amax(), 0.0);
}

#[test]
fn an_estimate_contains_a_camera() {
    let estimate = CameraEstimate {
        span_s: [0.0, 1.0],
        image_size_px: SIZE,
        principal_point_px: SIZE.centre_px(),
        lens: Lens { per_px2: -1e-7 },
        distortion_sd: Some(0.01),
        params: CameraParams { log_focal: 800_f64.ln(), tilt: 0.3, roll: 0.0, log_height: 2.0 },
        covariance: Matrix4::identity(),
        status: CameraStatus::Estimated,
        cars_used: 4,
        frames_used: 9,
        second_plane: None,
    };
    let camera = estimate.camera();
    assert!((camera.focal_px - 800.0).abs() < 1e-9);
    assert_eq!((camera.principal_point_px, camera.lens), (estimate.principal_point_px, estimate.lens));
}
