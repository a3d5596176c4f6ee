//! Tests of free poses (6 degrees of freedom): with and without plane terms, with given and with unknown focal length.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use roadplane_base::{Camera, ShapeAtlas, median};
use roadplane_solve::{
    CameraPrior, CarView, PlaneTerms, SceneOptions, SceneStatus, fit_free_car, solve_free_scene,
};
use roadplane_synth::{SynthOptions, scene};

#[test]
fn one_free_car_is_solved_exactly() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let options = SceneOptions { atlas_residual_scale: 0.0, ..SceneOptions::default() };
    let mut wrong = 0;
    for seed in 0..40 {
        let truth = scene(
            &atlas,
            &SynthOptions { cars: 2, shape_sd: 0.0, noise: 0.0, ..SynthOptions::default() },
            seed,
        );
        let camera = Camera::centred(truth.params.focal_px(), truth.size);
        for car in &truth.cars {
            let fit = fit_free_car(&atlas, &camera, &car.keypoints, &options).unwrap();
            let true_pose = truth.params.plane().camera_from_world() * car.pose.world_from_car();
            let angle = fit.camera_from_car.rotation.angle_to(&true_pose.rotation);
            let off = (fit.camera_from_car.translation.vector - true_pose.translation.vector).norm();
            wrong += usize::from(angle > 1e-4 || off > 1e-3 * true_pose.translation.vector.norm());
        }
    }
    assert!(wrong <= 1, "{wrong} of 80 cars");
}

#[test]
fn body_types_improve_the_distance_of_a_car() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let without_types = ShapeAtlas { body_types: Vec::new(), ..atlas.clone() };
    let (mut known, mut unknown) = (Vec::new(), Vec::new());
    for seed in 0..80 {
        let asked = SynthOptions { noise: 0.005, off_atlas: 1.0, ..SynthOptions::default() };
        let truth = scene(&atlas, &asked, 500 + seed);
        let camera = Camera::centred(truth.params.focal_px(), truth.size);
        for car in &truth.cars {
            let true_pose = truth.params.plane().camera_from_world() * car.pose.world_from_car();
            let log_error = |atlas: &ShapeAtlas| {
                let fit = fit_free_car(atlas, &camera, &car.keypoints, &SceneOptions::default()).unwrap();
                (fit.camera_from_car.translation.z / true_pose.translation.z).ln().abs()
            };
            known.push(log_error(&atlas));
            unknown.push(log_error(&without_types));
        }
    }
    let [known, unknown] = [known, unknown].map(|mut errors| median(&mut errors).unwrap());
    println!("distance off by {known:.4} with types, {unknown:.4} without");
    assert!(known < 0.95 * unknown, "{known} {unknown}");
}

#[test]
fn plane_terms_find_the_focal_length_from_far_off() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let terms = Some(PlaneTerms { distance_sd_m: 0.02, angle_sd: 0.005 });
    let asked = SynthOptions { cars: 8, noise: 0.01, focal_ratio: [0.6, 3.5], ..SynthOptions::default() };
    let (mut close, mut count) = (0, 0);
    for seed in 0..40 {
        let truth = scene(&atlas, &asked, 300 + seed);
        for ratio in [0.7, 2.4] {
            let camera_prior =
                CameraPrior { focal_ratio: ratio, log_focal_sd: 2.0, ..CameraPrior::default() };
            let options = SceneOptions { camera_prior, ..SceneOptions::default() };
            let found =
                solve_free_scene(&atlas, truth.size, &CarView::each(truth.keypoints()), terms, &options);
            count += 1;
            close += usize::from((found.params.log_focal - truth.params.log_focal).abs() < 0.25);
        }
    }
    println!("{close} of {count} within 25 %");
    assert!(close as f64 >= 0.9 * f64::from(count), "{close} of {count}");
}

#[test]
fn without_plane_and_focal_length_the_focal_length_is_the_prior() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let truth = scene(&atlas, &SynthOptions { cars: 4, ..SynthOptions::default() }, 2);
    let found = solve_free_scene(
        &atlas,
        truth.size,
        &CarView::each(truth.keypoints()),
        None,
        &SceneOptions::default(),
    );
    assert_eq!(found.status, SceneStatus::FocalFromPrior);
    let given = SceneOptions { given_focal_px: Some(truth.params.focal_px()), ..SceneOptions::default() };
    let found = solve_free_scene(&atlas, truth.size, &CarView::each(truth.keypoints()), None, &given);
    assert_eq!(found.status, SceneStatus::FocalGiven);
    assert!(found.cars.iter().all(Option::is_some));
    let nothing = solve_free_scene(&atlas, truth.size, &[], None, &given);
    assert_eq!(nothing.status, SceneStatus::TooFewCars);
}
