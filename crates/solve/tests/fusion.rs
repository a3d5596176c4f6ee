//! What frames say of the camera adds up in information form.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, ShapeAtlas};
use roadplane_solve::{CarView, SceneOptions, solve_scene};
use roadplane_synth::{SynthOptions, scene};

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
