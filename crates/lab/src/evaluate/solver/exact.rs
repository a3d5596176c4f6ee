//! Exactness of the solver on noise-free scenes, without a start and with a random camera as the start.

use roadplane_base::{ShapeAtlas, angle_difference};
use roadplane_solve::{CarView, LmOptions, SceneOptions, Steps, solve_scene};
use roadplane_synth::{SynthOptions, random_camera, scene};
use roadplane_tables::{Column, Table};

use super::scenes::without_camera_prior;
use crate::parallel::in_parallel;

/// Numbers of cars in a scene. Successive scenes use these numbers in turn.
const CARS: [usize; 3] = [3, 5, 10];
/// Largest errors of an exact solution: focal length (relative), angles (°) and positions (m).
const LIMITS: [f64; 3] = [1e-6, 1e-4, 1e-4];

/// Returns the table of the largest errors over `scenes` noise-free scenes whose cars have the mean shape.
///
/// One row is for solves without a start, one for solves with a random camera as the start.
#[must_use]
pub fn exact_table(atlas: &ShapeAtlas, scenes: usize) -> Table {
    let mut table = Table::new(
        "Noise-free scenes",
        "Cars of the mean shape, 3, 5 or 10 of them. Exact: focal length to 1e-6, every angle to 1e-4°, every \
         position to 1e-4 m.",
        vec![
            Column::new("start", 0),
            Column::new("scenes", 0),
            Column::new("exact, %", 1),
            Column::new("focal, largest", 0),
            Column::new("angle, largest °", 0),
            Column::new("position, largest m", 0),
        ],
    );
    for (name, random) in [("cold", false), ("at a random camera", true)] {
        let errors = in_parallel(scenes, |seed| errors_of(atlas, seed, random));
        let exact = errors.iter().filter(|e| e.iter().zip(LIMITS).all(|(e, limit)| *e < limit)).count();
        let largest = |k: usize| format!("{:.0e}", errors.iter().map(|e| e[k]).fold(0.0, f64::max));
        table.rows.push(vec![
            name.into(),
            (scenes as f64).into(),
            (100.0 * exact as f64 / scenes as f64).into(),
            largest(0).into(),
            largest(1).into(),
            largest(2).into(),
        ]);
    }
    table
}

/// Returns the errors of one scene: of the focal length (relative), the largest of the angles (°), and the largest of
/// the positions (m).
fn errors_of(atlas: &ShapeAtlas, seed: usize, random_start: bool) -> [f64; 3] {
    let asked =
        SynthOptions { cars: CARS[seed % CARS.len()], shape_sd: 0.0, noise: 0.0, ..SynthOptions::default() };
    let truth = scene(atlas, &asked, seed as u64);
    let lm =
        LmOptions { max_iterations: 200, cost_tolerance: 0.0, step_tolerance: 1e-9, ..LmOptions::default() };
    let start = random_start.then(|| random_camera(truth.size, seed as u64));
    // The bias correction assumes cars drawn from the population, but here all cars have the mean shape.
    let steps = Steps { bias: false, ..Steps::default() };
    let options = SceneOptions { lm, start, steps, ..without_camera_prior(0.0) };
    let found = solve_scene(atlas, truth.size, &CarView::each(truth.keypoints()), &options);
    let mut angle =
        (found.params.tilt - truth.params.tilt).abs().max((found.params.roll - truth.params.roll).abs());
    let mut position: f64 = 0.0;
    for (car, found) in truth.cars.iter().zip(&found.cars) {
        let Some(found) = found else { return [f64::INFINITY; 3] };
        position = position.max((found.ground.x_m - car.pose.x_m).hypot(found.ground.y_m - car.pose.y_m));
        angle = angle.max(angle_difference(found.ground.heading_rad, car.pose.heading_rad).abs());
    }
    [(found.params.log_focal - truth.params.log_focal).abs(), angle.to_degrees(), position]
}
