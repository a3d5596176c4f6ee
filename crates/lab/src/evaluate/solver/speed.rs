//! CPU time of a solve on one thread, for different numbers of cars.

use roadplane_base::ShapeAtlas;
use roadplane_solve::{CarView, GivenScene, SceneOptions, Steps, refine_scene, scene_bound, solve_scene};
use roadplane_synth::BenchScene;
use roadplane_tables::{Column, Mark, Plot, Table, median};

/// Number of scenes for each number of cars.
const SCENES: u64 = 5;
/// Least CPU time of one measurement, s. A shorter call is repeated.
const LEAST_S: f64 = 0.06;

/// CPU times for one number of cars. Each time is a median over scenes.
#[derive(Clone, Copy, Debug)]
pub struct SpeedPoint {
    /// Number of cars in the scene.
    pub cars: usize,
    /// Time of one joint refinement from a start near the truth, ms.
    pub refinement_ms: f64,
    /// Time of the set-up and the covariances, which the refinement time leaves out, ms.
    pub around_ms: f64,
    /// Number of linearisations in the refinement.
    pub iterations: f64,
    /// Time of a solve without a start, ms.
    pub cold_start_ms: f64,
}

/// Measures the CPU time of the refinement and of a cold start, for each number in `cars`.
#[must_use]
pub fn speed(atlas: &ShapeAtlas, cars: &[usize]) -> Vec<SpeedPoint> {
    cars.iter().map(|cars| point(atlas, *cars)).collect()
}

/// Returns the table of the CPU times, with one row per number of cars.
#[must_use]
pub fn speed_table(points: &[SpeedPoint]) -> Table {
    let mut table = Table::new(
        "Speed on one thread",
        "CPU time, median of five scenes, 2 % noise. Refinement: from 1 % off in focal length and height, 0.1° in \
         tilt, cars 1 % of their box. Cold start: a solve without a start.",
        vec![
            Column::new("cars", 0),
            Column::new("refinement, ms", 3),
            Column::new("a car and iteration, µs", 2),
            Column::new("iterations", 0),
            Column::new("set-up and covariances, ms", 3),
            Column::new("cold start, ms", 2),
        ],
    );
    for p in points {
        let a_car = 1e3 * p.refinement_ms / (p.cars as f64 * p.iterations);
        let numbers = [p.cars as f64, p.refinement_ms, a_car, p.iterations, p.around_ms, p.cold_start_ms];
        table.rows.push(numbers.map(Into::into).to_vec());
    }
    table
}

/// Returns a plot of the CPU times against the number of cars. The times grow linearly.
#[must_use]
pub fn speed_plot(points: &[SpeedPoint]) -> Plot {
    let line = |value: fn(&SpeedPoint) -> f64| points.iter().map(|p| (p.cars as f64, value(p))).collect();
    Plot::new("CPU time on one thread", "cars", "ms")
        .with("cold start", Mark::Line, line(|p| p.cold_start_ms))
        .with("refinement", Mark::Line, line(|p| p.refinement_ms))
}

/// Returns the CPU time that this thread has used, s. The kernel updates the value every few milliseconds.
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|n| n.parse::<f64>().ok()).unwrap_or(f64::NAN) * 1e-9
}

/// Returns the mean CPU time of a call (ms) and the result of the last call.
///
/// The call is repeated until the total CPU time is at least [`LEAST_S`].
fn timed<T>(mut work: impl FnMut() -> T) -> (f64, T) {
    let mut runs = 1.0;
    let start = cpu_seconds();
    let mut result = work();
    while cpu_seconds() - start < LEAST_S {
        result = work();
        runs += 1.0;
    }
    (1e3 * (cpu_seconds() - start) / runs, result)
}

fn point(atlas: &ShapeAtlas, cars: usize) -> SpeedPoint {
    let options = SceneOptions::default();
    // Refines the cars with six shape modes, to the minimum of the cost, without bias correction.
    let steps = Steps { bias: false, ..options.steps };
    let minimum = SceneOptions { steps, atlas_residual_scale: 0.0, ..options.clone() };
    let [mut refinement, mut around, mut iterations, mut cold] = [const { Vec::new() }; 4];
    for bench in (0..SCENES).filter_map(|seed| BenchScene::new(atlas, cars, seed)) {
        let (truth, views) = (&bench.truth, CarView::each(bench.truth.keypoints()));
        let from = GivenScene { params: bench.params, poses: &bench.poses, shapes: &bench.shapes };
        let (whole_ms, found) = timed(|| refine_scene(atlas, truth.size, &views, &from, &minimum));
        // Measures the same call without the refinement.
        let (around_ms, _) = timed(|| scene_bound(atlas, truth.size, &views, &from, &minimum));
        refinement.push(whole_ms - around_ms);
        around.push(around_ms);
        iterations.push(found.map_or(f64::NAN, |found| found.iterations as f64));
        cold.push(timed(|| solve_scene(atlas, truth.size, &views, &options)).0);
    }
    SpeedPoint {
        cars,
        refinement_ms: median(&refinement),
        around_ms: median(&around),
        iterations: median(&iterations),
        cold_start_ms: median(&cold),
    }
}
