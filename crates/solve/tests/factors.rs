//! Tests that factors (cost terms on the camera beside the cars) affect the estimate according to their sds.

use std::sync::Arc;

use roadplane_base::{CameraParams, Factor, ShapeAtlas};
use roadplane_solve::{CarView, SceneOptions, SceneSolution, solve_scene};
use roadplane_synth::{SynthOptions, scene};

/// Solves noisy synthetic scenes twice, without factors and with factors, and calls `show` with both solutions.
///
/// `factors` makes the factors from the true camera.
fn with_and_without(
    atlas: &ShapeAtlas,
    factors: impl Fn(&CameraParams) -> Vec<Factor>,
    show: impl Fn([&SceneSolution; 2], &CameraParams),
) {
    for seed in 0..6 {
        let asked = SynthOptions { cars: 5, noise: 0.02, ..SynthOptions::default() };
        let truth = scene(atlas, &asked, seed);
        let views = CarView::each(truth.keypoints());
        let solve = |factors| {
            solve_scene(atlas, truth.size, &views, &SceneOptions { factors, ..SceneOptions::default() })
        };
        let factors: Arc<[Factor]> = factors(&truth.params).into();
        show([&solve(Arc::new([])), &solve(factors)], &truth.params);
    }
}

#[test]
fn a_tight_factor_is_kept_and_narrows_other_parameters() {
    let factor = |truth: &CameraParams| vec![Factor::Number { which: 1, value: truth.tilt, sd: 1e-4 }];
    with_and_without(&ShapeAtlas::shipped().unwrap(), factor, |[without, with], truth| {
        assert!((with.params.tilt - truth.tilt).abs() < 1e-3);
        let sd = |solution: &SceneSolution, i: usize| solution.covariance[(i, i)].sqrt();
        let sds = [sd(with, 1), sd(with, 0), sd(without, 0)];
        assert!(sds[0] < 1.01e-4 && sds[1] < 1.05 * sds[2], "{sds:?}");
        let off = (with.params.log_focal - truth.log_focal).abs();
        assert!(off < 4.0 * sd(with, 0), "{off} at {}", sd(with, 0));
    });
}

#[test]
fn a_loose_factor_changes_nothing() {
    let factor =
        |truth: &CameraParams| vec![Factor::Number { which: 0, value: truth.log_focal + 1.0, sd: 1e4 }];
    with_and_without(&ShapeAtlas::shipped().unwrap(), factor, |[without, with], _| {
        assert!((without.params.to_vector() - with.params.to_vector()).amax() < 1e-5);
        assert!((without.covariance - with.covariance).amax() < 1e-6);
    });
}

#[test]
fn the_information_of_cars_does_not_contain_factors() {
    let factor = |truth: &CameraParams| vec![Factor::Number { which: 0, value: truth.log_focal, sd: 0.01 }];
    with_and_without(&ShapeAtlas::shipped().unwrap(), factor, |[without, with], _| {
        let counted = with.covariance.try_inverse().unwrap()[(0, 0)] - with.information.information[(0, 0)];
        let prior = 1.0 / (0.6 * 0.6);
        assert!((counted / (1e4 + prior) - 1.0).abs() < 1e-6, "{counted}");
        assert!(with.information.information[(0, 0)] < 3.0 * without.information.information[(0, 0)]);
    });
}
