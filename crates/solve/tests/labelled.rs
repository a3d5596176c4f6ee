//! Test of the solver on hand-labelled keypoints of real cars (VIRAT scene 0401, nine parked cars).

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::{fs, path::Path};

use nalgebra::Vector2;
use roadplane_base::{ImageSize, Keypoint, KeypointSet, ShapeAtlas, keypoint_names};
use roadplane_solve::{CarView, SceneOptions, SceneStatus, solve_scene};

fn labels() -> Vec<KeypointSet> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/keypoints/virat_0401.json");
    let text = fs::read_to_string(path).unwrap();
    let file: serde_json::Value = serde_json::from_str(&text).unwrap();
    let cars = file["cars"].as_array().unwrap().iter().map(|car| {
        let mut set: KeypointSet = [None; 36];
        for (name, label) in car["keypoints"].as_object().unwrap() {
            let index = keypoint_names().iter().position(|n| n == name).unwrap();
            let number = |i: usize| label[i].as_f64().unwrap();
            let clear = number(2) > 1.5;
            let (score, sd_px) = if clear { (0.95, 2.0) } else { (0.4, 4.0) };
            set[index] = Some(Keypoint::isotropic(Vector2::new(number(0), number(1)), score, sd_px));
        }
        set
    });
    cars.collect()
}

#[test]
#[ignore = "reads ../shared/data, which is not in the repository; scripts/test runs it where the data is present"]
fn the_parking_lot_has_plausible_numbers() {
    let cars = labels();
    let atlas = ShapeAtlas::shipped().unwrap();
    let views = CarView::each(&cars);
    let size = ImageSize { width: 1920, height: 1080 };
    let start = std::time::Instant::now();
    let scene = solve_scene(&atlas, size, &views, &SceneOptions::default());
    println!("{:?} in {:?}", scene.status, start.elapsed());
    let sd = scene.covariance.diagonal().map(f64::sqrt);
    println!(
        "focal {:.0} ± {:.1} %, tilt {:.2} ± {:.2}°, roll {:.2}°, height {:.2} m ± {:.1} %",
        scene.params.focal_px(),
        100.0 * sd[0],
        scene.params.tilt.to_degrees(),
        sd[1].to_degrees(),
        scene.params.roll.to_degrees(),
        scene.params.log_height.exp(),
        100.0 * sd[3]
    );
    let solved: Vec<_> = scene.cars.iter().map(|car| car.as_ref().unwrap()).collect();
    for car in &solved {
        let dims = atlas.dims_m(&car.shape);
        println!(
            "x {:6.2} y {:6.2} heading {:6.1}°  {:.2} × {:.2} × {:.2} m  rms {:.1} px  {} right  used {}  λ {:.1?}",
            car.ground.x_m,
            car.ground.y_m,
            car.ground.heading_rad.to_degrees(),
            dims.x,
            dims.y,
            dims.z,
            car.reprojection_rms_px,
            car.inliers.iter().filter(|i| **i).count(),
            car.used,
            car.shape.as_slice()
        );
    }
    let mut back: Vec<_> =
        solved.iter().filter(|car| car.ground.heading_rad.sin() > 0.0).map(|car| car.ground).collect();
    back.sort_by(|a, b| a.x_m.total_cmp(&b.x_m));
    let gaps: Vec<f64> = back.windows(2).map(|w| (w[1].x_m - w[0].x_m).hypot(w[1].y_m - w[0].y_m)).collect();
    println!("gaps {gaps:.2?}");
    assert_eq!(scene.status, SceneStatus::Converged);
    assert!((scene.params.focal_px() / 1653.0).ln().abs() < 0.15, "focal {}", scene.params.focal_px());
    assert!((6.0..15.0).contains(&scene.params.log_height.exp()));
    assert!((scene.params.tilt.to_degrees() - 24.1).abs() < 4.0);
    assert_eq!(back.len(), 5, "five cars face away");
    assert!(gaps.iter().all(|gap| (2.3..3.3).contains(gap)), "bays {gaps:?}");
    for car in solved {
        assert!(car.used);
        let dims = atlas.dims_m(&car.shape);
        assert!((4.0..5.2).contains(&dims.x) && (1.6..2.05).contains(&dims.y), "{dims:?}");
    }
}
