//! Accuracy against the Cramér–Rao bound, calibration of the reported sds, and the share of solves that reach the best
//! minimum.

use std::time::Instant;

use roadplane_base::{ShapeAtlas, angle_difference};
use roadplane_solve::{
    CameraPrior, CarSolution, CarView, GivenScene, SceneOptions, SceneSolution, refine_scene, solve_scene,
};
use roadplane_synth::{SceneTruth, SynthOptions, scene};
use roadplane_tables::{Cell, Column, Table, bootstrap, mean, median, share_within};

use super::scenes::{bound, foreign_cars, true_poses_and_shapes, without_camera_prior};
use crate::parallel::in_parallel;

/// Seed of the first scene.
const SEED: u64 = 1_000_000;
/// Two estimated cameras are the same minimum if they differ by less than this, in sds of the Cramér–Rao bound.
const SAME: f64 = 0.1;
/// Half the width of a 95 % interval of the normal distribution, in sds.
const NORMAL_95: f64 = 1.959_964;
/// The quantities whose errors the tables show.
const QUANTITIES: [&str; 4] = ["log focal", "tilt", "position", "heading"];

/// A row of the tables: the options of the synthetic scenes, and the options of the solve.
struct Row {
    name: &'static str,
    asked: SynthOptions,
    options: SceneOptions,
}

/// The errors of one scene, by index of the quantity in [`QUANTITIES`].
#[derive(Default)]
struct SceneErrors {
    /// Errors divided by the sds of the Cramér–Rao bound.
    by_bound: [Vec<f64>; 4],
    /// Errors divided by the reported sds.
    by_reported: [Vec<f64>; 4],
    /// Whether the solve reached the minimum that a start at the truth reaches, or a lower minimum.
    ///
    /// `None` if the scene has false cars. They have no true pose to start from.
    best_found: Option<bool>,
    /// Whether the solve reached a lower minimum than a start at the truth.
    lower: bool,
    milliseconds: f64,
}

/// Returns four tables: accuracy, bias, calibration and minima. Each row of a table is over `scenes` scenes.
#[must_use]
pub fn statistics_tables(atlas: &ShapeAtlas, scenes: usize) -> Vec<Table> {
    let quantities = |decimals| QUANTITIES.map(|title| Column::new(title, decimals));
    let mut accuracy = Table::new(
        "RMS error over the Cramér–Rao bound",
        "The bound is that of the right keypoints of the right cars (with the shape prior); cars of other models \
         count as cars of the atlas. Rows with N ≤ 2 use a camera prior with the moments of the scenes' cameras; \
         all other rows use none. 95 % intervals by resampling scenes.",
        [vec![Column::new("scenes", 0)], quantities(2).to_vec()].concat(),
    );
    let mut bias = Table::new(
        "Mean error in sd of the bound",
        "",
        [vec![Column::new("scenes", 0)], quantities(2).to_vec()].concat(),
    );
    let coverage = QUANTITIES.map(|title| Column::new(format!("{title} in 95 %"), 1));
    let mut calibration = Table::new(
        "RMS error over the reported sd, and share of 95 % intervals that hold the truth",
        "1 and 95 are calibrated.",
        [vec![Column::new("scenes", 0)], quantities(2).to_vec(), coverage.to_vec()].concat(),
    );
    let mut minima = Table::new(
        "Minimum reached from a cold start",
        "Best: the minimum that a start at the truth leads to, or a lower one of the same cars. No number if whole \
         cars are wrong.",
        ["scenes", "best, %", "of these lower, %", "median ms"].map(|title| Column::new(title, 1)).to_vec(),
    );
    for row in rows() {
        let errors: Vec<SceneErrors> = in_parallel(scenes, |i| scene_errors(atlas, &row, SEED + i as u64))
            .into_iter()
            .flatten()
            .collect();
        accuracy.rows.push(cells(row.name, &errors, |e, q| e.by_bound[q].clone(), rms));
        bias.rows.push(cells(row.name, &errors, |e, q| e.by_bound[q].clone(), mean));
        let mut reported = cells(row.name, &errors, |e, q| e.by_reported[q].clone(), rms);
        let sizes = |e: &SceneErrors, q: usize| e.by_reported[q].iter().map(|e| e.abs()).collect();
        reported.extend(cells("", &errors, sizes, |e| 100.0 * share_within(e, NORMAL_95)).split_off(1));
        calibration.rows.push(reported);
        let share = |wanted: fn(&SceneErrors) -> Option<bool>| {
            let one = |e: &SceneErrors| wanted(e).into_iter().map(|yes| f64::from(u8::from(yes))).collect();
            let each: Vec<Vec<f64>> = errors.iter().map(one).collect();
            bootstrap(&each, mean).scaled(100.0)
        };
        let times: Vec<f64> = errors.iter().map(|e| e.milliseconds).collect();
        minima.rows.push(vec![
            row.name.into(),
            share(|e| e.best_found).into(),
            share(|e| e.best_found.map(|_| e.lower)).into(),
            median(&times).into(),
        ]);
    }
    vec![accuracy, bias, calibration, minima]
}

fn cells(
    name: &str,
    scenes: &[SceneErrors],
    values: impl Fn(&SceneErrors, usize) -> Vec<f64>,
    statistic: fn(&[f64]) -> f64,
) -> Vec<Cell> {
    let quantity = |q| {
        let each: Vec<Vec<f64>> = scenes.iter().map(|scene| values(scene, q)).collect();
        Cell::from(bootstrap(&each, statistic))
    };
    std::iter::once(Cell::from(name)).chain((0..QUANTITIES.len()).map(quantity)).collect()
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|e| e * e).sum::<f64>() / values.len() as f64).sqrt()
}

fn rows() -> Vec<Row> {
    let base = SynthOptions::default();
    let plain = |name, cars, noise| Row {
        name,
        asked: SynthOptions { cars, noise, ..base.clone() },
        options: if cars < 3 {
            let camera_prior = population(&base);
            SceneOptions { atlas_residual_scale: 0.0, camera_prior, ..SceneOptions::default() }
        } else {
            without_camera_prior(0.0)
        },
    };
    let spoilt = |name, noise, outliers, wrong_cars| Row {
        name,
        asked: SynthOptions { cars: 10, noise, outliers, wrong_cars, ..base.clone() },
        options: without_camera_prior(0.0),
    };
    vec![
        plain("N 1, 1 %", 1, 0.01),
        plain("N 2, 1 %", 2, 0.01),
        plain("N 3, 1 %", 3, 0.01),
        plain("N 5, 0.5 %", 5, 0.005),
        plain("N 5, 1 %", 5, 0.01),
        plain("N 5, 2 %", 5, 0.02),
        plain("N 10, 1 %", 10, 0.01),
        plain("N 10, 2 %", 10, 0.02),
        plain("N 10, 4 %", 10, 0.04),
        plain("N 30, 2 %", 30, 0.02),
        spoilt("N 10, 1 %, 10 % outliers", 0.01, 0.1, 0.0),
        spoilt("N 10, 1 %, 20 % outliers", 0.01, 0.2, 0.0),
        spoilt("N 10, 2 %, 20 % outliers", 0.02, 0.2, 0.0),
        spoilt("N 10, 1 %, 10 % wrong cars", 0.01, 0.0, 0.1),
        spoilt("N 10, 1 %, 30 % wrong cars", 0.01, 0.0, 0.3),
        Row {
            name: "N 10, 2 %, cars of other models",
            asked: SynthOptions { cars: 10, noise: 0.02, models: foreign_cars(), ..base.clone() },
            options: without_camera_prior(1.0),
        },
        Row {
            name: "N 10, 2 %, cars beside the atlas",
            asked: SynthOptions { cars: 10, noise: 0.02, off_atlas: 1.0, ..base.clone() },
            options: without_camera_prior(1.0),
        },
    ]
}

/// Returns a prior with the mean and sd of the cameras in the synthetic scenes.
///
/// With one or two cars, the result depends much on the prior. The reported sd is calibrated only if the prior is.
fn population(asked: &SynthOptions) -> CameraPrior {
    // The sd of a uniform distribution is its width / √12.
    let moments = |[low, high]: [f64; 2]| ((low + high) / 2.0, (high - low) / 12f64.sqrt());
    let (log_focal, log_focal_sd) = moments(asked.focal_ratio.map(f64::ln));
    let (tilt, tilt_sd) = moments(asked.tilt);
    let (_, roll_sd) = moments(asked.roll);
    // Mean and sd of the logarithm of a uniformly distributed height.
    let [low, high] = asked.height_m;
    let integral = |h: f64| h * (h.ln() - 1.0);
    let square = |h: f64| h * (h.ln().powi(2) - 2.0 * h.ln() + 2.0);
    let mean = (integral(high) - integral(low)) / (high - low);
    let log_height_sd = ((square(high) - square(low)) / (high - low) - mean * mean).sqrt();
    CameraPrior {
        focal_ratio: log_focal.exp(),
        log_focal_sd,
        tilt,
        tilt_sd,
        roll_sd,
        height_m: mean.exp(),
        log_height_sd,
    }
}

fn scene_errors(atlas: &ShapeAtlas, row: &Row, seed: u64) -> Option<SceneErrors> {
    let truth = scene(atlas, &row.asked, seed);
    let bound = bound(atlas, &truth, &row.options)?;
    let views = CarView::each(truth.keypoints());
    let start = Instant::now();
    let found = solve_scene(atlas, truth.size, &views, &row.options);
    let mut errors =
        SceneErrors { milliseconds: 1e3 * start.elapsed().as_secs_f64(), ..SceneErrors::default() };
    let (poses, shapes) = true_poses_and_shapes(&truth);
    let at_truth = GivenScene { params: truth.params, poses: &poses, shapes: &shapes };
    let ideal = refine_scene(atlas, truth.size, &views, &at_truth, &row.options);
    if let (Some(ideal), false) = (ideal, truth.cars.iter().any(|car| car.wrong)) {
        let sd = bound.covariance.diagonal().map(f64::sqrt);
        let off = (found.params.to_vector() - ideal.params.to_vector()).component_div(&sd);
        let same = off.amax() < SAME;
        // Two costs can be compared only if both solves used the same cars.
        errors.lower = !same && found.cost < ideal.cost && used(&found) == used(&ideal);
        errors.best_found = Some(same || errors.lower);
    }
    add_camera(&mut errors, &found, &bound, &truth);
    for ((car, found), bound) in truth.cars.iter().zip(&found.cars).zip(&bound.cars) {
        if let (Some(found), Some(bound), false) = (found, bound, car.wrong)
            && bound.used
        {
            add_car(&mut errors, found, bound, &car.pose);
        }
    }
    Some(errors)
}

fn used(solution: &SceneSolution) -> Vec<bool> {
    solution.cars.iter().map(|car| car.as_ref().is_some_and(|car| car.used)).collect()
}

fn add(errors: &mut SceneErrors, quantity: usize, error: f64, bound_variance: f64, reported_variance: f64) {
    errors.by_bound[quantity].push(error / bound_variance.sqrt());
    errors.by_reported[quantity].push(error / reported_variance.sqrt());
}

fn add_camera(errors: &mut SceneErrors, found: &SceneSolution, bound: &SceneSolution, truth: &SceneTruth) {
    let off = found.params.to_vector() - truth.params.to_vector();
    for (quantity, i) in [(0, 0), (1, 1)] {
        add(errors, quantity, off[i], bound.covariance[(i, i)], found.covariance[(i, i)]);
    }
}

fn add_car(
    errors: &mut SceneErrors,
    found: &CarSolution,
    bound: &CarSolution,
    pose: &roadplane_base::GroundPose,
) {
    let off = [
        (2, found.ground.x_m - pose.x_m),
        (2, found.ground.y_m - pose.y_m),
        (3, angle_difference(found.ground.heading_rad, pose.heading_rad)),
    ];
    for (i, (quantity, off)) in off.into_iter().enumerate() {
        let (b, r) = (bound.ground_covariance[(i, i)], found.ground_covariance[(i, i)]);
        add(errors, quantity, off, b, r);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_scenes_fill_all_tables() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let tables = statistics_tables(&atlas, 3);
        assert_eq!(tables.len(), 4);
        assert!(tables.iter().all(|table| table.rows.len() == rows().len()));
    }
}
