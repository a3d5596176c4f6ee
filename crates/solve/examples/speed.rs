//! How long a solve takes on one thread, by number of cars:
//! `cargo run --release -p roadplane-solve --example speed -- [cars …]`. CPU time of the thread, median over scenes.

mod bench_scenes;

use bench_scenes::{BenchScene, timed};
use roadplane_base::ShapeAtlas;
use roadplane_solve::{SceneOptions, refine_scene, scene_bound, solve_scene};

const SCENES: u64 = 5;

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn main() -> Result<(), roadplane_base::AtlasError> {
    let atlas = ShapeAtlas::shipped()?;
    let options = SceneOptions::default();
    // The refinement alone, to the minimum.
    let alone = SceneOptions { marginal: false, ..options };
    let asked: Vec<usize> = std::env::args().skip(1).filter_map(|n| n.parse().ok()).collect();
    let counts = if asked.is_empty() { vec![1, 3, 5, 10, 20, 30, 50, 100, 200, 300] } else { asked };
    println!("cars  refinement ms  iterations  set-up and covariance ms  cold start ms  warm start ms");
    for cars in counts {
        let [mut refinement, mut iterations, mut around, mut cold, mut warm] = [const { Vec::new() }; 5];
        for scene in (0..SCENES).filter_map(|seed| BenchScene::new(&atlas, cars, seed)) {
            let (views, start, size) = (scene.views(), scene.start(), scene.truth.size);
            let (seconds, found) = timed(|| refine_scene(&atlas, size, &views, &start, &alone));
            refinement.push(1e3 * seconds);
            iterations.push(found.map_or(f64::NAN, |f| f.iterations as f64));
            around.push(1e3 * timed(|| scene_bound(&atlas, size, &views, &start, &options)).0);
            let (seconds, found) = timed(|| solve_scene(&atlas, size, &views, &options));
            cold.push(1e3 * seconds);
            let again = SceneOptions { start: Some(found.params), ..options };
            warm.push(1e3 * timed(|| solve_scene(&atlas, size, &views, &again)).0);
        }
        let [refinement, iterations, around, cold, warm] =
            [refinement, iterations, around, cold, warm].map(median);
        println!("{cars:4} {refinement:14.3} {iterations:11} {around:25.3} {cold:14.2} {warm:14.2}");
    }
    Ok(())
}
