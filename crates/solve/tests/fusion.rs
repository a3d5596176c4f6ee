//! What frames say of the camera adds up in information form.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, ShapeAtlas};
use roadplane_solve::{CameraPrior, CarView, SceneOptions, solve_scene};
use roadplane_synth::{SynthOptions, scene};

#[test]
fn dispersion_widens_the_cameras_covariance_alone() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let scene = scene(&atlas, &SynthOptions { cars: 8, noise: 0.01, ..SynthOptions::default() }, 11);
    let views: Vec<CarView<'_>> = scene
        .cars
        .iter()
        .enumerate()
        .map(|(group, car)| CarView { keypoints: &car.keypoints, group, weight: 1.0 })
        .collect();
    for (camera_prior, known_focal_px) in [
        (CameraPrior::none(), None),
        (CameraPrior::none(), Some(scene.params.focal_px())),
        (CameraPrior::default(), None),
    ] {
        let solve = |camera_dispersion: f64| {
            let options =
                SceneOptions { camera_prior, known_focal_px, camera_dispersion, ..SceneOptions::default() };
            solve_scene(&atlas, scene.size, &views, &options)
        };
        let (narrow, wide) = (solve(1.0), solve(4.0));
        assert_eq!((narrow.params, narrow.information), (wide.params, wide.information));
        assert_eq!(narrow.information_vector, wide.information_vector);
        let ratio = wide.covariance.component_div(&narrow.covariance);
        for i in (0..4).filter(|i| narrow.covariance[(*i, *i)] > 0.0) {
            // What was known before is not widened.
            let exact = camera_prior == CameraPrior::none();
            let right = if exact { (ratio[(i, i)] - 4.0).abs() < 1e-9 } else { ratio[(i, i)] < 4.0 };
            assert!(right && ratio[(i, i)] > 3.0, "{i}: {}", ratio[(i, i)]);
        }
        assert_eq!(known_focal_px.is_some(), wide.covariance[(0, 0)] == 0.0);
    }
}

#[test]
fn a_hundred_frames_pin_the_focal_length() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let options = SceneOptions::default();
    let mut errors = Vec::new();
    for (ratio, height, tilt) in [(0.8, 6.0, 0.35), (1.3, 10.0, 0.45), (2.5, 20.0, 0.3)] {
        let asked = SynthOptions {
            cars: 10,
            noise: 0.02,
            focal_ratio: [ratio; 2],
            height_m: [height; 2],
            tilt: [tilt; 2],
            roll: [0.01; 2],
            box_px: [40.0, 700.0],
            ..SynthOptions::default()
        };
        let prior = options.camera_prior.information();
        let mut information = Matrix4::from_diagonal(&prior);
        let mut vector: Vector4<f64> = Vector4::zeros();
        let mut truth = None;
        for frame in 0..100 {
            let scene = scene(&atlas, &asked, 5000 + frame);
            let cars = scene.cars.iter().enumerate();
            let views: Vec<CarView<'_>> =
                cars.map(|(group, car)| CarView { keypoints: &car.keypoints, group, weight: 1.0 }).collect();
            let found = solve_scene(&atlas, scene.size, &views, &options);
            if frame == 0 {
                vector = options.camera_prior.mean(scene.size).to_vector().component_mul(&prior);
            }
            information += found.information;
            vector += found.information_vector;
            truth = Some(scene.params);
        }
        let covariance = information.cholesky().unwrap().inverse();
        let fused = CameraParams::from_vector(&(covariance * vector));
        let off = fused.log_focal - truth.unwrap().log_focal;
        println!(
            "focal {:.0}: off {:+.2} %, reported sd {:.2} %",
            fused.focal_px(),
            100.0 * off,
            100.0 * covariance[(0, 0)].sqrt()
        );
        errors.push(off.abs());
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[1] < 0.015, "median {}", errors[1]);
}
