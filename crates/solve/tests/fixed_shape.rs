//! Tests that the covariance of a pose contains the uncertainty of a shape that other views gave.

use nalgebra::Matrix6;
use roadplane_base::{Camera, Lens, Shape, ShapeAtlas, angle_difference};
use roadplane_solve::{SceneOptions, ShapePrior, fit_car};
use roadplane_synth::{Rng, SynthOptions, scene};

/// Sd of the fixed shape coefficients.
const SHAPE_SD: f64 = 0.5;

/// Returns the rms of the normalised errors of x, y and heading over many cars. The prior of the shape states this sd.
fn normalised(atlas: &ShapeAtlas, stated_sd: f64) -> [f64; 3] {
    let options = SceneOptions { atlas_residual_scale: 0.0, ..SceneOptions::default() };
    let asked =
        SynthOptions { cars: 10, noise: 0.01, outliers: 0.0, off_atlas: 0.0, ..SynthOptions::default() };
    let mut rng = Rng::new(7);
    let (mut sums, mut count) = ([0.0; 3], 0.0);
    for seed in 0..40 {
        let truth = scene(atlas, &asked, 500 + seed);
        let camera = Camera {
            focal_px: truth.params.focal_px(),
            principal_point_px: truth.size.centre_px(),
            lens: Lens::STRAIGHT,
        };
        for car in &truth.cars {
            let error = Shape::from_fn(|_, _| SHAPE_SD * rng.normal());
            let prior = ShapePrior::fixed_at(
                atlas.clamped(&(car.shape + error)),
                Matrix6::identity() * stated_sd.powi(-2),
            );
            let plane = truth.params.plane();
            let Some(fit) = fit_car(atlas, &camera, &plane, &car.keypoints, &prior, None, &options) else {
                continue;
            };
            let turn = angle_difference(fit.car.ground.heading_rad, car.pose.heading_rad);
            if turn.abs() > 0.5 {
                continue;
            }
            let errors = [fit.car.ground.x_m - car.pose.x_m, fit.car.ground.y_m - car.pose.y_m, turn];
            for i in 0..3 {
                sums[i] += errors[i].powi(2) / fit.car.ground_covariance[(i, i)];
            }
            count += 1.0;
        }
    }
    assert!(count > 350.0, "{count} cars");
    sums.map(|sum| (sum / count).sqrt())
}

#[test]
fn the_sd_of_a_pose_contains_that_of_the_fixed_shape() {
    let atlas = ShapeAtlas::shipped().unwrap();
    // Coefficients beyond the bounds of the atlas are clamped, so the errors are a little smaller than the prior states.
    let stated = normalised(&atlas, SHAPE_SD);
    assert!(stated.iter().all(|ratio| (0.8..1.2).contains(ratio)), "{stated:?}");
    // If the shape counts as exact, the sds are too small.
    let exact = normalised(&atlas, 1e-4);
    assert!(exact.iter().all(|ratio| *ratio > 1.3), "{exact:?}");
}
