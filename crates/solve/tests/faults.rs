//! Tests that wrong cars and keypoints are rejected, and that the uncertainty of the solution is calibrated.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use roadplane_base::ShapeAtlas;
use roadplane_solve::{CameraPrior, CarView, SceneOptions, SceneSolution, Steps, solve_scene};
use roadplane_synth::{SceneTruth, SynthOptions, Wrong, scene};

fn solve(atlas: &ShapeAtlas, truth: &SceneTruth, steps: Steps) -> SceneSolution {
    let views = CarView::each(truth.keypoints());
    let options = SceneOptions {
        camera_prior: CameraPrior::none(),
        atlas_residual_scale: 0.0,
        steps,
        ..SceneOptions::default()
    };
    solve_scene(atlas, truth.size, &views, &options)
}

/// Solves scenes in which one fifth of the cars are wrong.
///
/// Returns three numbers: the share of wrong cars that are rejected, the share of right cars that are used, and the
/// normalised error of the focal length.
fn sorted_out(kind: Wrong, steps: Steps) -> [f64; 3] {
    let atlas = ShapeAtlas::shipped().unwrap();
    let [mut wrong, mut left_out, mut right, mut used, mut squares] = [0.0; 5];
    const SCENES: u64 = 16;
    for seed in 0..SCENES {
        let asked = SynthOptions {
            cars: 10,
            noise: 0.01,
            wrong_cars: 0.2,
            wrong: Some(kind),
            ..SynthOptions::default()
        };
        let truth = scene(&atlas, &asked, 300 + seed);
        let found = solve(&atlas, &truth, steps);
        let off = found.params.log_focal - truth.params.log_focal;
        squares += off * off / found.covariance[(0, 0)];
        for (car, found) in truth.cars.iter().zip(&found.cars) {
            let is_used = f64::from(u8::from(found.as_ref().is_some_and(|found| found.used)));
            if car.wrong {
                (wrong, left_out) = (wrong + 1.0, left_out + 1.0 - is_used);
            } else {
                (right, used) = (right + 1.0, used + is_used);
            }
        }
    }
    [left_out / wrong, used / right, f64::sqrt(squares / SCENES as f64)]
}

#[test]
fn wrong_cars_are_rejected() {
    for kind in [Wrong::Scattered, Wrong::OtherPose] {
        let [left_out, used, error] = sorted_out(kind, Steps::default());
        println!("{kind:?}: {left_out:.2} left out, {used:.2} used, normalised error {error:.2}");
        assert!(left_out > 0.8 && used > 0.97 && error < 2.0, "{kind:?}: {left_out} {used} {error}");
        let [kept_out, ..] = sorted_out(kind, Steps { rejection: false, ..Steps::default() });
        assert!(kept_out < 0.5, "{kind:?}: they are left out without the rejection, too: {kept_out}");
    }
}

/// A car with left and right keypoints exchanged resembles a car with the opposite heading.
///
/// The solver rejects some of these cars, and gives the remaining ones the opposite heading.
#[test]
fn mirrored_labels_do_not_turn_the_camera() {
    let [left_out, used, error] = sorted_out(Wrong::Mirrored, Steps::default());
    println!("{left_out:.2} left out, {used:.2} used, normalised error {error:.2}");
    assert!(left_out > 0.25 && used > 0.97 && error < 1.5, "{left_out} {used} {error}");
}

#[test]
fn reclassified_keypoints_find_a_lower_minimum() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let mut lower = 0;
    for seed in 0..60 {
        let asked = SynthOptions { cars: 10, noise: 0.01, outliers: 0.2, ..SynthOptions::default() };
        let truth = scene(&atlas, &asked, 1_000_000 + seed);
        let with = solve(&atlas, &truth, Steps::default());
        let without = solve(&atlas, &truth, Steps { reclassify: false, ..Steps::default() });
        assert!(with.cost <= without.cost + 1e-6, "{seed}: {} {}", with.cost, without.cost);
        lower += u32::from(with.cost < without.cost - 0.5);
    }
    println!("lower in {lower} of 60");
    assert!(lower >= 2, "{lower}");
}

#[test]
fn sds_are_neither_too_small_nor_too_large() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let mut squares: [Vec<f64>; 3] = Default::default();
    for seed in 0..60 {
        let asked = SynthOptions { cars: 6, noise: 0.01, ..SynthOptions::default() };
        let truth = scene(&atlas, &asked, 2_000_000 + seed);
        let found = solve(&atlas, &truth, Steps::default());
        let off = found.params.to_vector() - truth.params.to_vector();
        for i in 0..2 {
            squares[i].push(off[i].powi(2) / found.covariance[(i, i)]);
        }
        for (car, found) in truth.cars.iter().zip(found.cars.iter().flatten()) {
            squares[2].push((found.ground.y_m - car.pose.y_m).powi(2) / found.ground_covariance[(1, 1)]);
        }
    }
    for (name, squares) in ["log focal", "tilt", "distance"].iter().zip(&squares) {
        let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        println!("{name}: normalised error {rms:.2}");
        assert!((0.75..1.3).contains(&rms), "{name}: {rms}");
    }
}
