//! Tests with little or nonsensical data: the solver returns a status and a large, calibrated uncertainty, without NaN.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::time::Instant;

use nalgebra::{Matrix2, Vector2};
use roadplane_base::{CameraParams, ImageSize, KEYPOINTS, Keypoint, KeypointSet, ShapeAtlas};
use roadplane_solve::{
    CarView, GivenScene, LmOptions, SceneOptions, SceneSolution, SceneStatus, Termination, refine_scene,
    solve_scene,
};
use roadplane_synth::{Layout, Rng, SceneTruth, SynthOptions, scene};

const SIZE: ImageSize = ImageSize { width: 1920, height: 1080 };

fn solve(sets: &[KeypointSet], options: &SceneOptions) -> SceneSolution {
    let atlas = ShapeAtlas::shipped().unwrap();
    let views = CarView::each(sets);
    let start = Instant::now();
    let found = solve_scene(&atlas, SIZE, &views, options);
    assert!(start.elapsed().as_secs() < 10, "took {:?}", start.elapsed());
    assert!(found.params.to_vector().iter().all(|v| v.is_finite()), "{:?}", found.params);
    assert!(
        found.information.information.iter().chain(found.information.vector.iter()).all(|v| v.is_finite())
    );
    assert!(found.covariance.diagonal().iter().all(|v| *v >= 0.0), "{}", found.covariance);
    assert_eq!(found.cars.len(), sets.len());
    for car in found.cars.iter().flatten() {
        let numbers = car.ground_covariance.iter().chain(car.shape.iter()).chain(car.shape_covariance.iter());
        assert!(
            numbers.chain([&car.ground.x_m, &car.ground.y_m, &car.ground.heading_rad]).all(|v| v.is_finite())
        );
    }
    found
}

fn sets(truth: &SceneTruth) -> Vec<KeypointSet> {
    truth.cars.iter().map(|car| car.keypoints).collect()
}

/// Returns how well the sd of the focal length is calibrated over random scenes.
///
/// The first number is the share of scenes in which the error exceeds 3 reported sds. The second is the mean reported
/// sd of log f.
fn focal_calibration(asked: &SynthOptions, scenes: u64) -> (f64, f64) {
    let atlas = ShapeAtlas::shipped().unwrap();
    let (mut beyond, mut sd_sum) = (0, 0.0);
    for seed in 0..scenes {
        let truth = scene(&atlas, asked, 7000 + seed);
        let found = solve(&sets(&truth), &SceneOptions::default());
        let sd = found.covariance[(0, 0)].sqrt();
        let off = (found.params.log_focal - truth.params.log_focal).abs();
        if off > 3.0 * sd {
            println!(
                "seed {seed}: focal {:.0} true {:.0}, sd {sd:.3}, tilt {:.1}° true {:.1}°, {:?}",
                found.params.focal_px(),
                truth.params.focal_px(),
                found.params.tilt.to_degrees(),
                truth.params.tilt.to_degrees(),
                found.status
            );
            beyond += 1;
        }
        sd_sum += sd;
    }
    (f64::from(beyond) / scenes as f64, sd_sum / scenes as f64)
}

#[test]
fn no_usable_car_gives_the_prior() {
    for cars in [vec![], vec![[None; KEYPOINTS]], vec![[None; KEYPOINTS]; 5]] {
        let found = solve(&cars, &SceneOptions::default());
        assert_eq!(found.status, SceneStatus::TooFewCars);
        assert!((found.covariance[(0, 0)].sqrt() - 0.6).abs() < 1e-9, "the stated prior");
        assert!(!found.status.usable());
    }
}

#[test]
fn infinite_and_huge_numbers_are_rejected() {
    let truth =
        scene(&ShapeAtlas::shipped().unwrap(), &SynthOptions { cars: 4, ..SynthOptions::default() }, 1);
    let clean = solve(&sets(&truth), &SceneOptions::default());
    let bad = [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300];
    for value in bad {
        let mut poisoned = sets(&truth);
        poisoned[0][3] = Some(Keypoint::isotropic(Vector2::new(value, 10.0), 1.0, 1.0));
        poisoned[1][4] = Some(Keypoint::isotropic(Vector2::new(10.0, 10.0), value, 1.0));
        poisoned[2][5] = Some(Keypoint {
            pixel: Vector2::new(9.0, 9.0),
            score: 1.0,
            covariance_px2: Matrix2::repeat(value),
        });
        let found = solve(&poisoned, &SceneOptions::default());
        assert!((found.params.log_focal - clean.params.log_focal).abs() < 0.2, "{value}");
        let whole = [[Some(Keypoint::isotropic(Vector2::new(value, value), value, value)); KEYPOINTS]; 3];
        assert_eq!(solve(&whole, &SceneOptions::default()).status, SceneStatus::TooFewCars);
        let options = SceneOptions {
            given_focal_px: Some(value),
            start: Some(CameraParams { log_focal: value, tilt: value, roll: 0.0, log_height: 1.0 }),
            ..SceneOptions::default()
        };
        solve(&sets(&truth), &options);
    }
    for sd in [0.0, -1.0, 1e-30, 1e30] {
        let flat = [[Some(Keypoint::isotropic(Vector2::new(5.0, 5.0), 1.0, sd)); KEYPOINTS]; 2];
        solve(&flat, &SceneOptions::default());
    }
}

#[test]
fn keypoints_on_a_point_or_a_line_or_anywhere() {
    let mut rng = Rng::new(5);
    let mut cars: Vec<KeypointSet> = Vec::new();
    let at = |x, y| Some(Keypoint::isotropic(Vector2::new(x, y), 1.0, 2.0));
    cars.push([at(500.0, 500.0); KEYPOINTS]);
    cars.push(std::array::from_fn(|i| at(100.0 + 10.0 * i as f64, 300.0)));
    cars.push(std::array::from_fn(|_| at(rng.uniform(0.0, 1920.0), rng.uniform(0.0, 1080.0))));
    cars.push(std::array::from_fn(|_| at(rng.uniform(-1e6, 1e6), rng.uniform(-1e6, 1e6))));
    for car in &cars {
        solve(&[*car], &SceneOptions::default());
        solve(&[*car; 6], &SceneOptions::default());
    }
    solve(&cars, &SceneOptions::default());
}

#[test]
fn one_and_two_cars_have_calibrated_uncertainties() {
    for cars in [1, 2] {
        let asked = SynthOptions { cars, noise: 0.02, focal_ratio: [0.7, 2.2], ..SynthOptions::default() };
        let (beyond, mean_sd) = focal_calibration(&asked, 60);
        println!("{cars} cars: {beyond:.3} beyond 3 sd, mean sd {mean_sd:.3}");
        assert!(beyond <= 0.034 && mean_sd > 0.04);
    }
}

#[test]
fn rows_parallels_and_extreme_tilts_stay_calibrated() {
    let base = SynthOptions { cars: 6, noise: 0.02, focal_ratio: [0.7, 2.2], ..SynthOptions::default() };
    let degrees = |low: f64, high: f64| [low.to_radians(), high.to_radians()];
    let asked = [
        ("parallel", SynthOptions { layout: Layout::Parallel, ..base.clone() }),
        ("one row", SynthOptions { layout: Layout::OneRow, cars: 4, ..base.clone() }),
        ("parking rows", SynthOptions { layout: Layout::Rows, ..base.clone() }),
        (
            "nearly top-down",
            SynthOptions { tilt: degrees(70.0, 86.0), height_m: [15.0, 40.0], ..base.clone() },
        ),
        ("nearly level", SynthOptions { tilt: degrees(0.0, 3.0), height_m: [2.0, 4.0], ..base.clone() }),
    ];
    for (name, asked) in asked {
        let (beyond, mean_sd) = focal_calibration(&asked, 40);
        println!("{name}: {beyond:.3} beyond 3 sd, mean sd {mean_sd:.3}");
        assert!(beyond <= 0.051, "{name}");
    }
}

#[test]
fn the_same_car_many_times_is_one_car() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let truth = scene(&atlas, &SynthOptions { cars: 3, noise: 0.02, ..SynthOptions::default() }, 11);
    let once = solve(&sets(&truth), &SceneOptions::default());
    // Each car appears ten times in one group, each time with a tenth of the weight. Together this is the evidence of
    // one view with weight 1.
    let mut views = Vec::new();
    for (group, car) in truth.cars.iter().enumerate() {
        views.extend([CarView { keypoints: &car.keypoints, group, weight: 0.1 }; 10]);
    }
    let many = solve_scene(&atlas, truth.size, &views, &SceneOptions::default());
    assert_eq!(many.status, SceneStatus::Converged);
    let ratio = many.covariance[(0, 0)] / once.covariance[(0, 0)];
    assert!((many.params.log_focal - once.params.log_focal).abs() < 0.3 * once.covariance[(0, 0)].sqrt());
    assert!((0.8..1.25).contains(&ratio), "variance ratio {ratio}");
}

#[test]
fn order_of_cars_does_not_matter() {
    let atlas = ShapeAtlas::shipped().unwrap();
    for seed in 0..10 {
        let truth = scene(
            &atlas,
            &SynthOptions { cars: 6, noise: 0.02, outliers: 0.1, ..SynthOptions::default() },
            seed,
        );
        let forward = solve(&sets(&truth), &SceneOptions::default());
        let mut reversed = sets(&truth);
        reversed.reverse();
        let backward = solve(&reversed, &SceneOptions::default());
        let off = (forward.params.to_vector() - backward.params.to_vector()).amax();
        assert!(off < 1e-4, "seed {seed}: {off}");
        let again = solve(&sets(&truth), &SceneOptions::default());
        assert_eq!(again.params, forward.params, "same input, same bits");
    }
}

#[test]
fn a_solve_that_stops_near_the_minimum_is_usable() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let truth = scene(&atlas, &SynthOptions { cars: 6, noise: 0.02, ..SynthOptions::default() }, 3);
    let sets = sets(&truth);
    let poses: Vec<_> = truth.cars.iter().map(|car| car.pose).collect();
    let shapes: Vec<_> = truth.cars.iter().map(|car| car.shape).collect();
    let refined = |max_iterations, further| {
        let mut params = truth.params;
        params.log_focal += further;
        let from = GivenScene { params, poses: &poses, shapes: &shapes };
        let lm =
            LmOptions { max_iterations, cost_tolerance: 0.0, step_tolerance: 0.0, ..LmOptions::default() };
        let options = SceneOptions { lm, ..SceneOptions::default() };
        refine_scene(&atlas, truth.size, &CarView::each(&sets), &from, &options).unwrap()
    };
    let far = refined(1, 0.3);
    assert_eq!((far.termination, far.status), (Termination::MaxIterations, SceneStatus::NotConverged));
    let near = refined(10, 0.0);
    assert_eq!((near.termination, near.status), (Termination::Near, SceneStatus::Converged));
    let (found, exact) = (near.params.log_focal, refined(200, 0.0).params.log_focal);
    assert!((found - exact).abs() < 0.1 * near.covariance[(0, 0)].sqrt(), "{found} and {exact}");
}
