//! Tests of the last steps of a solve: refinement with all modes, body types, weights of cars, bias correction.
//!
//! All solves start from the true scene, because these tests do not cover the search.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use nalgebra::Vector3;
use roadplane_base::{FINE_MODES, ShapeAtlas};
use roadplane_solve::{
    CameraPrior, CarView, GivenScene, LmOptions, SceneOptions, SceneSolution, Steps, refine_scene,
};
use roadplane_synth::{CarModel, Rng, SceneTruth, SynthOptions, draw_shape, scene};

const ALL: Steps =
    Steps { rejection: true, reclassify: true, all_modes: true, body_types: true, trust: false, bias: false };

/// Returns a scene with cars of `models` different random shapes of all modes.
///
/// `shape_sd` returns the number by which the coefficients of each shape are multiplied. The sd of the keypoint noise
/// is 0.3 % of the longer side of a car's box.
fn truth(atlas: &ShapeAtlas, seed: u64, models: usize, shape_sd: impl Fn(usize) -> f64) -> SceneTruth {
    let mut rng = Rng::new(seed);
    let mut model = |number| {
        let shape = draw_shape(atlas, &mut rng) * shape_sd(number);
        let keypoints_in_car = std::array::from_fn(|i| atlas.keypoint_of_all_modes(i, &shape));
        CarModel { model: String::new(), weight: 1.0, keypoints_in_car }
    };
    let models = (0..models).map(&mut model).collect();
    scene(atlas, &SynthOptions { models, noise: 0.003, ..SynthOptions::default() }, seed)
}

/// Refines a scene from the solution `from` or, if it is `None`, from the true scene.
///
/// The problem treats each group of `views_per_car` consecutive cars as views of one car.
fn refine(
    atlas: &ShapeAtlas,
    truth: &SceneTruth,
    views_per_car: usize,
    from: Option<&SceneSolution>,
    steps: Steps,
    given_focal_px: Option<f64>,
) -> SceneSolution {
    let cars = truth.cars.iter().enumerate();
    let views: Vec<CarView<'_>> = cars
        .map(|(i, car)| CarView { keypoints: &car.keypoints, group: i / views_per_car, weight: 1.0 })
        .collect();
    let (params, (poses, shapes)): (_, (Vec<_>, Vec<_>)) = match from {
        None => (truth.params, truth.cars.iter().map(|car| (car.pose, car.shape)).unzip()),
        Some(found) => (found.params, found.cars.iter().flatten().map(|car| (car.ground, car.shape)).unzip()),
    };
    let lm = LmOptions { cost_tolerance: 1e-13, ..LmOptions::default() };
    let camera_prior = CameraPrior::none();
    let options = SceneOptions { camera_prior, steps, lm, given_focal_px, ..SceneOptions::default() };
    refine_scene(atlas, truth.size, &views, &GivenScene { params, poses: &poses, shapes: &shapes }, &options)
        .unwrap()
}

/// Returns the error of one camera parameter; `number` is its index in (log f, tilt, roll, log h).
fn error(atlas: &ShapeAtlas, truth: &SceneTruth, steps: Steps, number: usize) -> f64 {
    let found = refine(atlas, truth, 1, None, steps, None);
    (found.params.to_vector() - truth.params.to_vector())[number]
}

#[test]
fn without_fine_modes_nothing_changes() {
    let shipped = ShapeAtlas::shipped().unwrap();
    let mut atlas = shipped.clone();
    atlas.body_types.clear();
    atlas.fine_modes = [atlas.mean.map(|_| Vector3::zeros()); FINE_MODES];
    // The model of all modes multiplies the residual sd by √2. The division cancels this.
    atlas.fine_residual_sd_m = atlas.residual_sd_m.map(|sd| sd / std::f64::consts::SQRT_2);
    for seed in 0..6 {
        // Only the problem with six modes has bounds, so the coefficients are small enough to stay within them. In
        // every second scene all cars are equal, and each pair of cars counts as two views of one car.
        let (models, views_per_car) = if seed % 2 == 0 { (40, 1) } else { (1, 2) };
        let truth = truth(&shipped, seed, models, |_| 0.3);
        let given_focal_px = (seed % 3 == 0).then(|| truth.params.focal_px());
        let six = Steps { all_modes: false, ..ALL };
        let refine =
            |from: Option<&_>, steps| refine(&atlas, &truth, views_per_car, from, steps, given_focal_px);
        // The refinement is repeated until the whitening belongs to the final poses.
        let mut found = refine(None, six);
        for _ in 0..3 {
            found = refine(Some(&found), six);
        }
        let sd = found.covariance.diagonal().map(|variance| variance.sqrt().max(1e-9));
        let off = |a: &SceneSolution, b: &SceneSolution| {
            (a.params.to_vector() - b.params.to_vector()).component_div(&sd).amax()
        };
        let all = refine(Some(&found), ALL);
        assert!(off(&all, &found) < 1e-3, "{seed}: {}", off(&all, &found));
        let scale = sd * sd.transpose();
        assert!((all.covariance - found.covariance).component_div(&scale).amax() < 1e-3);
        // The bias correction must be equal, too.
        let six = refine(Some(&found), Steps { bias: true, ..six });
        let all = refine(Some(&found), Steps { bias: true, ..ALL });
        assert!(off(&six, &all) < 1e-2 && off(&six, &found) > 1e-2, "{seed}: {}", off(&six, &all));
    }
}

/// The bias correction enlarges the world.
///
/// At the joint minimum, the world is too small, because in a smaller world all shape coefficients are nearer to their
/// mean.
#[test]
fn integrating_out_makes_the_world_larger() {
    let atlas = ShapeAtlas::shipped().unwrap();
    for seed in 0..12 {
        let truth = truth(&atlas, seed, 40, |_| 1.0);
        let height = |bias| error(&atlas, &truth, Steps { bias, ..ALL }, 3);
        let change = height(true) - height(false);
        assert!((1e-4..0.03).contains(&change), "{seed}: {change}");
    }
}

#[test]
fn all_modes_improve_the_camera() {
    let atlas = ShapeAtlas { body_types: Vec::new(), ..ShapeAtlas::shipped().unwrap() };
    let (mut six, mut all) = (0.0, 0.0);
    for seed in 0..40 {
        let truth = truth(&atlas, seed, 40, |_| 1.0);
        six += error(&atlas, &truth, Steps { all_modes: false, ..ALL }, 0).abs();
        all += error(&atlas, &truth, ALL, 0).abs();
    }
    assert!(all < 0.7 * six, "{all} against {six}");
}

#[test]
fn body_types_improve_the_scale_of_the_scene() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let (mut known, mut unknown, mut squared_sds) = (0.0, 0.0, 0.0);
    for seed in 0..40 {
        let truth = truth(&atlas, seed, 40, |_| 1.0);
        let found = refine(&atlas, &truth, 1, None, ALL, None);
        let off = found.params.log_height - truth.params.log_height;
        known += off.abs();
        squared_sds += off * off / found.covariance[(3, 3)] / 40.0;
        unknown += error(&atlas, &truth, Steps { body_types: false, ..ALL }, 3).abs();
    }
    assert!(squared_sds < 1.5, "{squared_sds}");
    assert!(known < 0.85 * unknown, "{known} against {unknown}");
}

#[test]
fn a_few_cars_unlike_the_atlas_do_not_turn_the_camera() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let (mut trusted, mut weighed) = (0.0, 0.0);
    for seed in 0..60 {
        let truth = truth(&atlas, seed, 40, |model| if model % 6 == 0 { 4.0 } else { 0.7 });
        trusted += error(&atlas, &truth, ALL, 0).abs();
        weighed += error(&atlas, &truth, Steps { trust: true, ..ALL }, 0).abs();
    }
    assert!(weighed < 0.9 * trusted, "{weighed} against {trusted}");
}
