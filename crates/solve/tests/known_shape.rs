//! Tests that the covariance of a pose contains the uncertainty of a shape that is known from other views.

use nalgebra::Matrix6;
use roadplane_base::{Camera, Lens, Shape, ShapeAtlas, angle_difference};
use roadplane_solve::{SceneOptions, ShapePrior, fit_car};
use roadplane_synth::{Rng, SynthOptions, scene};

/// Sd of the known shape coefficients.
const SHAPE_SD: f64 = 0.5;

/// Returns the rms of the normalised errors of x, y and heading over many cars. The shape has this sd, and the fit is told
/// `told_sd`.
fn normalised(told_sd: f64) -> [f64; 3] {
    let atlas = ShapeAtlas::shipped().unwrap();
    let options = SceneOptions { atlas_residual_scale: 0.0, ..SceneOptions::default() };
    let asked =
        SynthOptions { cars: 10, noise: 0.01, outliers: 0.0, off_atlas: 0.0, ..SynthOptions::default() };
    let mut rng = Rng::new(7);
    let (mut sums, mut count) = ([0.0; 3], 0.0);
    for seed in 0..40 {
        let truth = scene(&atlas, &asked, 500 + seed);
        let camera = Camera {
            focal_px: truth.params.focal_px(),
            principal_point_px: truth.size.centre_px(),
            lens: Lens::STRAIGHT,
        };
        for car in &truth.cars {
            let error = Shape::from_fn(|_, _| SHAPE_SD * rng.normal());
            let known = ShapePrior::fixed_at(
                atlas.clamped(&(car.shape + error)),
                Matrix6::identity() * told_sd.powi(-2),
            );
            let plane = truth.params.plane();
            let Some(fit) = fit_car(&atlas, &camera, &plane, &car.keypoints, &known, None, &options) else {
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
fn the_sd_of_a_pose_contains_that_of_the_known_shape() {
    // Coefficients beyond the bounds of the atlas are clamped, so the errors are a little smaller than told.
    let told = normalised(SHAPE_SD);
    assert!(told.iter().all(|ratio| (0.8..1.2).contains(ratio)), "{told:?}");
    // If the shape counts as exact, the sds are too small.
    let exact = normalised(1e-4);
    assert!(exact.iter().all(|ratio| *ratio > 1.3), "{exact:?}");
}
