//! Tests that noise-free scenes are solved exactly, both after a search and from a random start of the camera.

use roadplane_base::{ShapeAtlas, angle_difference};
use roadplane_solve::{CameraPrior, CarView, LmOptions, SceneOptions, Steps, solve_scene};
use roadplane_synth::{SynthOptions, random_camera, scene};

#[test]
fn noise_free_scenes_come_out_exactly() {
    exact(&ShapeAtlas::shipped().unwrap(), false);
}

#[test]
fn noise_free_scenes_come_out_exactly_from_any_camera() {
    exact(&ShapeAtlas::shipped().unwrap(), true);
}

fn exact(atlas: &ShapeAtlas, random_start: bool) {
    let tight =
        LmOptions { max_iterations: 200, cost_tolerance: 0.0, step_tolerance: 1e-9, ..LmOptions::default() };
    let options = SceneOptions {
        camera_prior: CameraPrior::none(),
        atlas_residual_scale: 0.0,
        // All cars have the mean shape. They are not a random sample of the population, so the bias correction would be
        // wrong.
        steps: Steps { bias: false, ..Steps::default() },
        lm: tight,
        ..SceneOptions::default()
    };
    let scenes: u64 = std::env::var("ROADPLANE_SCENES").ok().and_then(|n| n.parse().ok()).unwrap_or(60);
    let mut failed = Vec::new();
    for seed in 0..scenes {
        let cars = [3, 5, 10][seed as usize % 3];
        let asked = SynthOptions { cars, shape_sd: 0.0, noise: 0.0, ..SynthOptions::default() };
        let truth = scene(atlas, &asked, seed);
        let views = CarView::each(truth.keypoints());
        let start = random_start.then(|| random_camera(truth.size, seed));
        let found = solve_scene(atlas, truth.size, &views, &SceneOptions { start, ..options.clone() });
        let focal = (found.params.log_focal - truth.params.log_focal).abs();
        let turn =
            (found.params.tilt - truth.params.tilt).abs().max((found.params.roll - truth.params.roll).abs());
        let mut position: f64 = 0.0;
        let mut heading: f64 = 0.0;
        for (car, found) in truth.cars.iter().zip(&found.cars) {
            let Some(found) = found else {
                position = f64::INFINITY;
                continue;
            };
            position = position.max((found.ground.x_m - car.pose.x_m).hypot(found.ground.y_m - car.pose.y_m));
            heading = heading.max(angle_difference(found.ground.heading_rad, car.pose.heading_rad).abs());
        }
        let exact = focal < 1e-6 && turn.max(heading) < 1e-4_f64.to_radians() && position < 1e-4;
        if !exact {
            println!(
                "seed {seed} N {cars}: focal {focal:.1e} (true ratio {:.2}, found {:.2}) tilt {:.1}° turn {turn:.1e} heading {heading:.1e} \
                 position {position:.1e} {:?} {:?} cost {:.2e}",
                truth.params.focal_px() / 1920.0,
                found.params.focal_px() / 1920.0,
                truth.params.tilt.to_degrees(),
                found.status,
                found.termination,
                found.cost
            );
            failed.push(seed);
        }
    }
    assert!(failed.is_empty(), "{} of {scenes} scenes: {failed:?}", failed.len());
}
