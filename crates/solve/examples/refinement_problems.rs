//! Writes joint refinement problems as text for another solver, and prints our solver's CPU time and cost for them.
//!
//! Run `cargo run --release -p roadplane-solve --example refinement_problems -- DIR` (see `scripts/bench/ceres`).
//!
//! The file of each problem contains numbers in this order:
//!
//! - `t²` of the outlier model; mean and information of the camera prior (4 + 4);
//! - start of the camera (log f, tilt, roll, log h); number of cars;
//! - for each car: anchor u, v (px from the principal point), heading, six shape coefficients, number of keypoints;
//! - for each keypoint: index, x, y (px from the principal point), sd in px, weight.
//!
//! The file `atlas.txt` contains the shape atlas: the mean car (36 × 3 numbers) and the modes (6 × 36 × 3 numbers).

use std::fmt::Write as _;
use std::path::Path;

use roadplane_base::{Camera, MODES, ShapeAtlas};
use roadplane_solve::{CarView, GivenScene, SceneOptions, Steps, refine_scene};
use roadplane_synth::BenchScene;

/// Returns the CPU time that this thread has used, s; the kernel updates it in steps of milliseconds.
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|n| n.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}

/// Repeats `work` for at least 60 ms, and returns the mean CPU time per run (s) and the last result.
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

/// Returns the camera, poses and shapes at which the refinement starts.
fn start(scene: &BenchScene) -> GivenScene<'_> {
    GivenScene { params: scene.params, poses: &scene.poses, shapes: &scene.shapes }
}

fn atlas_text(atlas: &ShapeAtlas) -> String {
    let points = atlas.mean.iter().chain(atlas.modes.iter().flatten());
    points.map(|p| format!("{:e} {:e} {:e}\n", p.x, p.y, p.z)).collect()
}

fn problem_text(scene: &BenchScene, options: &SceneOptions) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    let start = start(scene);
    let size = scene.truth.size;
    let numbers = |v: &[f64]| v.iter().map(|n| format!("{n:e}")).collect::<Vec<_>>().join(" ");
    writeln!(text, "{:e}", options.kernel.threshold_squared)?;
    let prior = options.camera_prior;
    writeln!(text, "{}", numbers(prior.mean(size).to_vector().as_slice()))?;
    writeln!(text, "{}", numbers(prior.information().as_slice()))?;
    writeln!(text, "{}", numbers(start.params.to_vector().as_slice()))?;
    writeln!(text, "{}", scene.truth.cars.len())?;
    let camera = Camera::centred(start.params.focal_px(), size);
    let camera_from_world = start.params.plane().camera_from_world();
    for ((car, pose), shape) in scene.truth.cars.iter().zip(start.poses).zip(start.shapes) {
        let origin = camera_from_world * nalgebra::Point3::new(pose.x_m, pose.y_m, 0.0);
        let anchor = camera.pixel_from_camera(&origin.coords).unwrap_or_default() - size.centre_px();
        writeln!(text, "{:e} {:e} {:e}", anchor.x, anchor.y, pose.heading_rad)?;
        writeln!(text, "{}", numbers(shape.as_slice()))?;
        writeln!(text, "{}", car.keypoints.iter().flatten().count())?;
        for (index, keypoint) in car.keypoints.iter().enumerate() {
            let Some(keypoint) = keypoint else { continue };
            let at = keypoint.pixel - size.centre_px();
            let sd = keypoint.covariance_px2[(0, 0)].sqrt();
            writeln!(text, "{index} {:e} {:e} {sd:e} {:e}", at.x, at.y, keypoint.score)?;
        }
    }
    Ok(text)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: refinement_problems DIR")?;
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    let mut atlas = ShapeAtlas::shipped()?;
    // Shapes have no bounds, because with them Ceres stalls above the minimum.
    atlas.bounds = [[f64::NEG_INFINITY, f64::INFINITY]; MODES];
    // The atlas' residual in the image depends on the pose. Without this residual, both solvers use the same keypoint
    // weights.
    let steps = Steps { bias: false, ..Steps::default() };
    let options = SceneOptions { atlas_residual_scale: 0.0, steps, ..SceneOptions::default() };
    std::fs::write(folder.join("atlas.txt"), atlas_text(&atlas))?;
    println!("name cars milliseconds iterations cost");
    for cars in [5, 20, 50, 200] {
        for seed in 0..5 {
            let scene = BenchScene::new(&atlas, cars, seed).ok_or("no such start")?;
            let name = format!("{cars:03}_{seed}");
            std::fs::write(folder.join(format!("{name}.txt")), problem_text(&scene, &options)?)?;
            let (views, start) = (CarView::each(scene.truth.keypoints()), start(&scene));
            let (seconds, found) = timed(|| refine_scene(&atlas, scene.truth.size, &views, &start, &options));
            let found = found.ok_or("the refinement failed")?;
            println!(
                "{name} {} {} {} {:e}",
                scene.truth.cars.len(),
                1e3 * seconds,
                found.iterations,
                found.cost
            );
        }
    }
    Ok(())
}
