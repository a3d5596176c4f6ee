//! Accuracy against the Cramér–Rao bound, calibration of the reported sd, convergence: the tables of the solver.
//!
//! `cargo run --release -p roadplane-solve --example statistics -- [scenes per row [part of a row's name [verbose]]]`

use std::time::Instant;

use roadplane_base::{GroundPose, Shape, ShapeAtlas, angle_difference};
use roadplane_solve::{
    CameraPrior, CarView, KnownScene, OutlierModel, SceneOptions, SceneSolution, refine_scene, scene_bound,
    solve_scene,
};
use roadplane_synth::{SceneTruth, SynthOptions, scene};

/// Errors of one quantity in units of the bound's sd and of the reported sd.
#[derive(Default)]
struct Quantity {
    by_bound: Vec<f64>,
    by_reported: Vec<f64>,
}

impl Quantity {
    fn add(&mut self, error: f64, bound_variance: f64, reported_variance: f64) {
        self.by_bound.push(error / bound_variance.sqrt());
        self.by_reported.push(error / reported_variance.sqrt());
    }

    fn text(&self) -> String {
        let n = self.by_bound.len().max(1) as f64;
        let rms = |v: &[f64]| (v.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
        let bias = self.by_bound.iter().sum::<f64>() / n;
        let covered = self.by_reported.iter().filter(|e| e.abs() < 1.96).count() as f64 / n;
        format!(
            "{:5.2} {:+5.2} {:5.2} {:4.0}%",
            rms(&self.by_bound),
            bias,
            rms(&self.by_reported),
            100.0 * covered
        )
    }
}

struct Row {
    name: &'static str,
    asked: SynthOptions,
}

fn views(truth: &SceneTruth) -> Vec<CarView<'_>> {
    let view = |(group, car)| {
        let car: &roadplane_synth::CarTruth = car;
        CarView { keypoints: &car.keypoints, group, weight: 1.0 }
    };
    truth.cars.iter().enumerate().map(view).collect()
}

/// The bound of the right keypoints of the right cars.
fn bound(atlas: &ShapeAtlas, truth: &SceneTruth, options: &SceneOptions) -> Option<SceneSolution> {
    let mut right = truth.clone();
    for car in &mut right.cars {
        for i in 0..car.keypoints.len() {
            if car.wrong || car.outlier[i] {
                car.keypoints[i] = None;
            }
        }
    }
    let (poses, shapes) = known(&right);
    let options = SceneOptions { kernel: OutlierModel::none(), ..*options };
    scene_bound(
        atlas,
        truth.size,
        &views(&right),
        &KnownScene { params: truth.params, poses: &poses, shapes: &shapes },
        &options,
    )
}

fn known(truth: &SceneTruth) -> (Vec<GroundPose>, Vec<Shape>) {
    truth.cars.iter().map(|car| (car.pose, car.shape)).unzip()
}

fn main() -> Result<(), roadplane_base::AtlasError> {
    let mut arguments = std::env::args().skip(1);
    let scenes: u64 = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(100);
    let only = arguments.next();
    let verbose = arguments.next().is_some();
    let atlas = ShapeAtlas::shipped()?;
    let base = SynthOptions::default();
    let row = |name, asked| Row { name, asked };
    let rows = [
        row("N 3  noise 1%", SynthOptions { cars: 3, noise: 0.01, ..base.clone() }),
        row("N 5  noise 0.5%", SynthOptions { cars: 5, noise: 0.005, ..base.clone() }),
        row("N 5  noise 1%", SynthOptions { cars: 5, noise: 0.01, ..base.clone() }),
        row("N 5  noise 2%", SynthOptions { cars: 5, noise: 0.02, ..base.clone() }),
        row("N 10 noise 1%", SynthOptions { cars: 10, noise: 0.01, ..base.clone() }),
        row("N 10 noise 2%", SynthOptions { cars: 10, noise: 0.02, ..base.clone() }),
        row("N 10 noise 4%", SynthOptions { cars: 10, noise: 0.04, ..base.clone() }),
        row("N 30 noise 2%", SynthOptions { cars: 30, noise: 0.02, ..base.clone() }),
        row("N 10 1% 20% outliers", SynthOptions { cars: 10, noise: 0.01, outliers: 0.2, ..base.clone() }),
        row("N 10 2% 20% outliers", SynthOptions { cars: 10, noise: 0.02, outliers: 0.2, ..base.clone() }),
        row(
            "N 10 1% 10% wrong cars",
            SynthOptions { cars: 10, noise: 0.01, wrong_cars: 0.1, ..base.clone() },
        ),
        row(
            "N 10 1% 30% wrong cars",
            SynthOptions { cars: 10, noise: 0.01, wrong_cars: 0.3, ..base.clone() },
        ),
        row("N 10 2% off atlas", SynthOptions { cars: 10, noise: 0.02, off_atlas: 1.0, ..base.clone() }),
    ];
    println!(
        "RMS error / bound, bias, RMS error / reported sd, coverage of 95 % intervals; same minimum as from the truth or a lower one"
    );
    println!("{:24} {:^24} {:^24} {:^24} {:^24}", "", "log focal", "tilt", "position", "heading");
    for Row { name, asked } in rows {
        if only.as_ref().is_some_and(|only| !name.contains(only.as_str())) {
            continue;
        }
        let options = SceneOptions {
            camera_prior: CameraPrior::none(),
            atlas_residual_scale: asked.off_atlas,
            ..SceneOptions::default()
        };
        let [mut focal, mut tilt, mut position, mut heading] = std::array::from_fn(|_| Quantity::default());
        let (mut same, mut lower, mut count, mut seconds) = (0, 0, 0, 0.0);
        let mut statuses = std::collections::BTreeMap::<String, usize>::new();
        for seed in 0..scenes {
            let truth = scene(&atlas, &asked, 1_000_000 + seed);
            let Some(bound) = bound(&atlas, &truth, &options) else { continue };
            let views = views(&truth);
            let start = Instant::now();
            let found = solve_scene(&atlas, truth.size, &views, &options);
            seconds += start.elapsed().as_secs_f64();
            count += 1;
            *statuses.entry(format!("{:?}", found.status)).or_default() += 1;
            let (poses, shapes) = known(&truth);
            let ideal = KnownScene { params: truth.params, poses: &poses, shapes: &shapes };
            // Wrong cars have no pose to start from.
            let right: Vec<CarView<'_>> = views
                .iter()
                .zip(&truth.cars)
                .map(|(view, car)| CarView { weight: if car.wrong { 0.0 } else { 1.0 }, ..*view })
                .collect();
            let ideal = refine_scene(&atlas, truth.size, &right, &ideal, &options);
            let used = |s: &SceneSolution| -> Vec<bool> {
                s.cars.iter().map(|car| car.as_ref().is_some_and(|car| car.used)).collect()
            };
            let reached = ideal.as_ref().is_some_and(|ideal| {
                let off = (found.params.to_vector() - ideal.params.to_vector())
                    .component_div(&bound.covariance.diagonal().map(f64::sqrt));
                let below = off.amax() >= 0.1 && found.cost < ideal.cost && used(&found) == used(ideal);
                lower += usize::from(below);
                off.amax() < 0.1 || below
            });
            same += usize::from(reached);
            if verbose && !reached {
                let ideal = ideal.as_ref();
                println!(
                    "  seed {seed}: cost {:.2} from truth {:.2}; focal {:.0} true {:.0} (bound sd {:.3}), from truth {:.0}; tilt {:.2} true {:.2} {:?} {:?} used {}",
                    found.cost,
                    ideal.map_or(f64::NAN, |i| i.cost),
                    found.params.focal_px(),
                    truth.params.focal_px(),
                    bound.covariance[(0, 0)].sqrt(),
                    ideal.map_or(f64::NAN, |i| i.params.focal_px()),
                    found.params.tilt.to_degrees(),
                    truth.params.tilt.to_degrees(),
                    found.status,
                    found.termination,
                    found.cars.iter().flatten().filter(|car| car.used).count()
                );
            }
            let off = found.params.to_vector() - truth.params.to_vector();
            focal.add(off[0], bound.covariance[(0, 0)], found.covariance[(0, 0)]);
            tilt.add(off[1], bound.covariance[(1, 1)], found.covariance[(1, 1)]);
            for ((car, found), bound) in truth.cars.iter().zip(&found.cars).zip(&bound.cars) {
                let (Some(found), Some(bound)) = (found, bound) else { continue };
                if car.wrong || !bound.used {
                    continue;
                }
                let (b, r) = (&bound.ground_covariance, &found.ground_covariance);
                position.add(found.ground.x_m - car.pose.x_m, b[(0, 0)], r[(0, 0)]);
                position.add(found.ground.y_m - car.pose.y_m, b[(1, 1)], r[(1, 1)]);
                heading.add(
                    angle_difference(found.ground.heading_rad, car.pose.heading_rad),
                    b[(2, 2)],
                    r[(2, 2)],
                );
            }
        }
        println!(
            "{name:24} {} {} {} {}   {:.1} % ({:.1} lower)  {:.1} ms  {statuses:?}",
            focal.text(),
            tilt.text(),
            position.text(),
            heading.text(),
            100.0 * same as f64 / count as f64,
            100.0 * lower as f64 / count as f64,
            1e3 * seconds / count as f64
        );
    }
    Ok(())
}
