//! Estimates the errors of the direction from which a net sees a car. One error is of each car alone, and all cars of a
//! camera share the other error.
//!
//! The settings `solve.keypoints_as_one`, `solve.shared_view_sd_deg` and `solve.mean_elevation_error_deg` come from
//! this table.
//!
//! The view error e (elevation or turn) of car k in front of camera c is modelled as
//!
//! ```text
//! e = g_k μ + b_c + d_k        d_k ~ N(0, m σ²), b_c ~ N(0, s² + variance of the truth)
//! ```
//!
//! The symbols are:
//!
//! - b_c: the error that all cars of camera c share.
//! - d_k: the own error of car k.
//! - σ: the sd of d_k if keypoint errors are independent (m = 1). A car that fits badly has a larger σ.
//! - m: the number of keypoints that share one error.
//! - s: the sd of b_c.
//! - μ: the mean error of a car that is seen from the front or rear.
//! - g_k: cos² of the angle on the ground between the heading of car k and the line of sight.
//!
//! The table has the values of m, s and μ with the greatest likelihood. The values of m and s are on a grid. For each
//! point of the grid, the best μ has a closed form.

use roadplane_tables::{Column, Table, bootstrap_scenes};

use super::measured::{Measured, counted};

/// Step sizes of the grid: for m, and for s in degrees.
const STEP: [f64; 2] = [0.5, 0.1];
/// Number of grid points along each axis.
const STEPS: usize = 41;

/// The cars of one camera. Each car has a view error, the error's sd for independent keypoints (both rad), and g.
///
/// `truth_sd` is the sd of the reference camera's angle, rad.
struct CameraCars {
    cars: Vec<[f64; 3]>,
    truth_sd: f64,
}

/// The cost of a camera's cars at a point of the grid, as a function of μ (rad): `at_zero − slope · μ + bend · μ² / 2`.
#[derive(Clone, Copy, Debug)]
struct Cost {
    at_zero: f64,
    slope: f64,
    bend: f64,
}

/// Returns the table of the most likely m, s and μ.
///
/// The table has one row for elevation and one for turn.
pub(super) fn table(measured: &[&Measured]) -> Table {
    let mut table = Table::new(
        "Errors of view",
        "Most likely values. Keypoints as one: the number of keypoints of a car that share one error. Shared: the sd \
         of the error that all cars of a camera share. Mean: mean error of cars seen from the front or rear. 95 % \
         intervals by resampling cameras.",
        vec![
            Column::new("", 0),
            Column::new("keypoints as one", 1),
            Column::new("shared, °", 2),
            Column::new("mean, °", 2),
        ],
    );
    for (number, name) in ["elevation", "turn"].into_iter().enumerate() {
        let cars_of = |m: &&Measured| CameraCars {
            cars: counted(m).map(|car| [car.errors[number], car.claimed[number], car.along]).collect(),
            truth_sd: m.camera.sd[number + 1],
        };
        let cameras: Vec<Vec<Cost>> = measured.iter().map(|m| costs(&cars_of(m))).collect();
        let of =
            |which: usize| bootstrap_scenes(&cameras, cameras.len(), |chosen| most_likely(chosen)[which]);
        table.rows.push(vec![name.into(), of(0).into(), of(1).into(), of(2).into()]);
    }
    table
}

/// Returns the cost (minus log likelihood) of one camera's cars at each point of the grid of m and s.
fn costs(camera: &CameraCars) -> Vec<Cost> {
    let all = (0..STEPS * STEPS).map(on_grid);
    all.map(|[as_one, shared_deg]| cost(camera, as_one, shared_deg.to_radians())).collect()
}

/// Returns the values of m and s (degrees) at the grid point with index `at`. The first m is one step, the first s is
/// 0.
fn on_grid(at: usize) -> [f64; 2] {
    [STEP[0] * (at / STEPS + 1) as f64, STEP[1] * (at % STEPS) as f64]
}

/// Returns the values of m, s (degrees) and μ (degrees) at which the sum of the cameras' costs is least.
fn most_likely(cameras: &[&Vec<Cost>]) -> [f64; 3] {
    let least = |at: usize| {
        let sum = |of: fn(&Cost) -> f64| cameras.iter().map(|costs| of(&costs[at])).sum::<f64>();
        let (slope, bend) = (sum(|cost| cost.slope), sum(|cost| cost.bend));
        let mean = if bend > 0.0 { slope / bend } else { 0.0 };
        (sum(|cost| cost.at_zero) - 0.5 * slope * mean, mean)
    };
    let all = (0..STEPS * STEPS).map(|at| (least(at), at));
    let best = all.min_by(|((a, _), _), ((b, _), _)| a.total_cmp(b));
    best.map_or([0.0; 3], |((_, mean), at)| {
        let [as_one, shared_deg] = on_grid(at);
        [as_one, shared_deg, mean.to_degrees()]
    })
}

/// Returns minus the log likelihood of the errors of one camera's cars.
///
/// The covariance is a diagonal matrix plus the variance that all cars share, so the Sherman–Morrison formula inverts
/// it.
fn cost(camera: &CameraCars, as_one: f64, shared: f64) -> Cost {
    let common = shared * shared + camera.truth_sd * camera.truth_sd;
    let (mut information, mut pull, mut cost) = (0.0, 0.0, 0.0);
    let (mut sum, mut slope, mut bend) = (0.0, 0.0, 0.0);
    for [error, claimed, along] in &camera.cars {
        let variance = as_one * claimed * claimed + 1e-12;
        information += 1.0 / variance;
        pull += error / variance;
        cost += 0.5 * (error * error / variance + variance.ln());
        sum += along / variance;
        slope += along * error / variance;
        bend += along * along / variance;
    }
    let more = 1.0 + common * information;
    Cost {
        at_zero: cost + 0.5 * (more.ln() - common * pull * pull / more),
        slope: slope - common * sum * pull / more,
        bend: bend - common * sum * sum / more,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_synth::Rng;

    #[test]
    fn the_true_mean_and_sds_of_simulated_errors_are_found() {
        let mut random = Rng::new(3);
        let [claimed, shared] = [1.0_f64, 1.0].map(f64::to_radians);
        let mean = 0.5_f64.to_radians();
        let cameras: Vec<Vec<Cost>> = (0..300)
            .map(|_| {
                let truth_sd = 0.005;
                let common = shared.hypot(truth_sd) * random.normal();
                let car = |random: &mut Rng| {
                    let along = random.unit();
                    [along * mean + common + 4_f64.sqrt() * claimed * random.normal(), claimed, along]
                };
                costs(&CameraCars { cars: (0..8).map(|_| car(&mut random)).collect(), truth_sd })
            })
            .collect();
        let found = most_likely(&cameras.iter().collect::<Vec<_>>());
        let within = [0.5, 0.11, 0.15];
        assert!((0..3).all(|i| (found[i] - [4.0, 1.0, 0.5][i]).abs() <= within[i]), "{found:?}");
    }
}
