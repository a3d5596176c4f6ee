//! How long a solve takes on one thread, by number of cars: CPU time, whatever else the machine does.

use nalgebra::{Point3, Vector2};
use roadplane_base::{Camera, CameraParams, GroundPose, Shape, ShapeAtlas};
use roadplane_solve::{KnownScene, SceneOptions, refine_scene, solve_scene};
use roadplane_synth::{Rng, SceneTruth, SynthOptions, scene};

use super::scenes::views;
use crate::{Column, Mark, Plot, Table, median};

/// Scenes a number of cars.
const SCENES: u64 = 5;
/// CPU time spent on each figure at least, s.
const LEAST_S: f64 = 0.06;

/// Times of one number of cars, medians over scenes.
#[derive(Clone, Copy, Debug)]
pub struct SpeedPoint {
    /// Cars in the scene.
    pub cars: usize,
    /// One joint refinement from a near start, ms.
    pub refinement_ms: f64,
    /// Its linearisations.
    pub iterations: f64,
    /// From nothing, ms.
    pub cold_start_ms: f64,
}

/// Measures refinement and cold start.
#[must_use]
pub fn speed(atlas: &ShapeAtlas, cars: &[usize]) -> Vec<SpeedPoint> {
    cars.iter().map(|cars| point(atlas, *cars)).collect()
}

/// The figures as a table.
#[must_use]
pub fn speed_table(points: &[SpeedPoint]) -> Table {
    let mut table = Table::new(
        "Speed on one thread",
        "CPU time, median of five scenes, 2 % noise. Refinement: from 1 % off in focal length and height, 0.1° in tilt, cars 1 % of their box. \
         Cold start: from nothing.",
        vec![
            Column::new("cars", 0),
            Column::new("refinement, ms", 3),
            Column::new("a car, µs", 1),
            Column::new("iterations", 0),
            Column::new("cold start, ms", 2),
        ],
    );
    for p in points {
        let a_car = 1e3 * p.refinement_ms / p.cars as f64;
        let numbers = [p.cars as f64, p.refinement_ms, a_car, p.iterations, p.cold_start_ms];
        table.rows.push(numbers.map(Into::into).to_vec());
    }
    table
}

/// Times against the number of cars: straight lines, since cost is linear in cars.
#[must_use]
pub fn speed_plot(points: &[SpeedPoint]) -> Plot {
    let line = |value: fn(&SpeedPoint) -> f64| points.iter().map(|p| (p.cars as f64, value(p))).collect();
    Plot::new("CPU time on one thread", "cars", "ms")
        .with("cold start", Mark::Line, line(|p| p.cold_start_ms))
        .with("refinement", Mark::Line, line(|p| p.refinement_ms))
}

/// CPU seconds of this thread; the kernel counts in steps of milliseconds.
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|n| n.parse::<f64>().ok()).unwrap_or(f64::NAN) * 1e-9
}

/// CPU milliseconds that one run takes, from as many as fill [`LEAST_S`], and the last one's result.
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
    let [mut refinement, mut iterations, mut cold] = [const { Vec::new() }; 3];
    for seed in 0..SCENES {
        let truth = bench_scene(atlas, cars, seed);
        let Some((params, poses, shapes)) = near(&truth) else { continue };
        let views = views(&truth);
        let from = KnownScene { params, poses: &poses, shapes: &shapes };
        let (ms, found) = timed(|| refine_scene(atlas, truth.size, &views, &from, &options));
        refinement.push(ms);
        iterations.push(found.map_or(f64::NAN, |found| found.iterations as f64));
        cold.push(timed(|| solve_scene(atlas, truth.size, &views, &options)).0);
    }
    SpeedPoint {
        cars,
        refinement_ms: median(&refinement),
        iterations: median(&iterations),
        cold_start_ms: median(&cold),
    }
}

/// Many cars need room, so they come with a higher camera.
fn bench_scene(atlas: &ShapeAtlas, cars: usize, seed: u64) -> SceneTruth {
    let many = cars > 30;
    let asked = SynthOptions {
        cars,
        noise: 0.02,
        box_px: if many { [12.0, 300.0] } else { [50.0, 700.0] },
        height_m: if many { [25.0, 45.0] } else { [4.0, 30.0] },
        tilt: if many { [0.35, 0.7] } else { [0.087, 0.87] },
        focal_ratio: [0.6, if many { 0.9 } else { 4.0 }],
        ..SynthOptions::default()
    };
    scene(atlas, &asked, 40 + seed)
}

/// A start as the stages before the last refinement leave it; cars are about where they are seen.
fn near(truth: &SceneTruth) -> Option<(CameraParams, Vec<GroundPose>, Vec<Shape>)> {
    let mut rng = Rng::new(9);
    let mut params = truth.params;
    params.log_focal += 0.01;
    params.tilt += 0.002;
    params.log_height -= 0.01;
    let camera_from_world = truth.params.plane().camera_from_world();
    let camera = Camera::centred(truth.params.focal_px(), truth.size);
    let started = Camera::centred(params.focal_px(), truth.size);
    let mut poses = Vec::new();
    let mut shapes = Vec::new();
    for car in &truth.cars {
        let origin = camera_from_world * Point3::new(car.pose.x_m, car.pose.y_m, 0.0);
        let moved = Vector2::new(rng.normal(), rng.normal()) * (0.01 * car.box_px);
        let seen = camera.pixel_from_camera(&origin.coords)? + moved;
        let on_ground = params.plane().world_from_pixel(&started, &seen)?;
        let heading_rad = car.pose.heading_rad + 0.01 * rng.normal();
        poses.push(GroundPose { x_m: on_ground.x, y_m: on_ground.y, heading_rad });
        shapes.push(car.shape.map(|c| c + 0.3 * rng.normal()));
    }
    Some((params, poses, shapes))
}
