//! How long a solve takes on one thread, by number of cars: `cargo run --release -p roadplane-solve --example speed`.
//! CPU time of the thread (whatever else the machine does), median over scenes.

use roadplane_base::{GroundPose, Shape, ShapeAtlas};
use roadplane_solve::{CarView, KnownScene, SceneOptions, refine_scene, solve_scene};
use roadplane_synth::{Rng, SceneTruth, SynthOptions, scene};

/// CPU seconds of this thread; the kernel counts in steps of milliseconds.
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|n| n.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}

/// CPU seconds that one run takes, from as many as fill 60 ms, and the last one's result.
fn timed<T>(mut work: impl FnMut() -> T) -> (f64, T) {
    let mut runs = 1.0;
    let start = cpu_seconds();
    let mut result = work();
    while cpu_seconds() - start < 0.06 {
        result = work();
        runs += 1.0;
    }
    ((cpu_seconds() - start) / runs, result)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The truth disturbed as the stages before the last refinement leave it: 1 % in focal length and height, 0.1° in tilt,
/// 3 cm, 0.6°, a third of a sd of shape.
fn near(truth: &SceneTruth) -> (roadplane_base::CameraParams, Vec<GroundPose>, Vec<Shape>) {
    let mut rng = Rng::new(9);
    let mut params = truth.params;
    params.log_focal += 0.01;
    params.tilt += 0.002;
    params.log_height -= 0.01;
    let poses = truth.cars.iter().map(|car| GroundPose {
        x_m: car.pose.x_m + 0.03 * rng.normal(),
        y_m: car.pose.y_m + 0.03 * rng.normal(),
        heading_rad: car.pose.heading_rad + 0.01 * rng.normal(),
    });
    let poses = poses.collect();
    let shapes = truth.cars.iter().map(|car| car.shape.map(|c| c + 0.3 * rng.normal())).collect();
    (params, poses, shapes)
}

fn main() -> Result<(), roadplane_base::AtlasError> {
    let atlas = ShapeAtlas::shipped()?;
    let options = SceneOptions::default();
    println!(
        "{:>5} {:>16} {:>12} {:>14} {:>14}",
        "cars", "refinement ms", "iterations", "cold start ms", "warm start ms"
    );
    for cars in [1, 3, 5, 10, 20, 30, 50, 100, 200, 300] {
        let (mut refinement, mut iterations, mut cold, mut warm) = (vec![], vec![], vec![], vec![]);
        for seed in 0..5 {
            let asked = SynthOptions {
                cars,
                noise: 0.02,
                // Many cars need room.
                box_px: if cars > 30 { [12.0, 300.0] } else { [50.0, 700.0] },
                height_m: if cars > 30 { [25.0, 45.0] } else { [4.0, 30.0] },
                tilt: if cars > 30 { [0.35, 0.7] } else { [0.087, 0.87] },
                focal_ratio: [0.6, if cars > 30 { 0.9 } else { 4.0 }],
                ..SynthOptions::default()
            };
            let truth = scene(&atlas, &asked, 40 + seed);
            let views: Vec<CarView<'_>> = truth
                .cars
                .iter()
                .enumerate()
                .map(|(group, car)| CarView { keypoints: &car.keypoints, group, weight: 1.0 })
                .collect();
            let (params, poses, shapes) = near(&truth);
            let from = KnownScene { params, poses: &poses, shapes: &shapes };
            let (seconds, found) = timed(|| refine_scene(&atlas, truth.size, &views, &from, &options));
            refinement.push(seconds);
            iterations.push(found.map_or(0.0, |f| f.iterations as f64));
            let (seconds, found) = timed(|| solve_scene(&atlas, truth.size, &views, &options));
            cold.push(seconds);
            let again = SceneOptions { start: Some(found.params), ..options };
            let (seconds, _) = timed(|| solve_scene(&atlas, truth.size, &views, &again));
            warm.push(seconds);
            if truth.cars.len() < cars && seed == 0 {
                println!("  ({} of {cars} cars found room)", truth.cars.len());
            }
        }
        println!(
            "{cars:5} {:16.3} {:12} {:14.2} {:14.2}",
            1e3 * median(refinement),
            median(iterations),
            1e3 * median(cold),
            1e3 * median(warm)
        );
    }
    Ok(())
}
