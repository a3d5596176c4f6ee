//! Errors of the views of cars: of each car alone, and of all cars of a camera together. The settings
//! `solve.keypoints_as_one` and `solve.shared_view_sd_deg` come from this table.
//!
//! The error of car k in front of camera c is modelled as
//!
//! ```text
//! e = b_c + d_k        d_k ~ N(0, m σ²), b_c ~ N(0, s² + variance of the truth)
//! ```
//!
//! Here σ is the claimed sd, scaled by the car's misfit. m and s are the most likely values on a grid.

use roadplane_tables::{Column, Table, bootstrap_scenes};

use super::measured::{Measured, counted};

/// Steps of the grid: of m, and of s in degrees.
const STEP: [f64; 2] = [0.5, 0.1];
/// Number of steps in each direction.
const STEPS: usize = 41;

/// The cars of a camera: errors (rad) and claimed sds with keypoints as independent; and the sd of the truth.
struct CameraCars {
    cars: Vec<[f64; 2]>,
    truth_sd: f64,
}

/// Returns the table of m and s for elevation and turn.
pub(super) fn table(measured: &[&Measured]) -> Table {
    let mut table = Table::new(
        "Errors of view",
        "Most likely values. Keypoints as one: the number of keypoints of a car that share one error. Shared: the sd \
         of the error that all cars of a camera share. 95 % intervals by resampling cameras.",
        vec![Column::new("", 0), Column::new("keypoints as one", 1), Column::new("shared, °", 2)],
    );
    for (number, name) in ["elevation", "turn"].into_iter().enumerate() {
        let cars_of = |m: &&Measured| CameraCars {
            cars: counted(m).map(|car| [car.errors[number], car.claimed[number]]).collect(),
            truth_sd: m.camera.sd[number + 1],
        };
        let cameras: Vec<Vec<f64>> = measured.iter().map(|m| costs(&cars_of(m))).collect();
        let of =
            |which: usize| bootstrap_scenes(&cameras, cameras.len(), |chosen| most_likely(chosen)[which]);
        table.rows.push(vec![name.into(), of(0).into(), of(1).into()]);
    }
    table
}

/// Returns the cost (minus log likelihood) of a camera's cars at each point of the grid.
fn costs(camera: &CameraCars) -> Vec<f64> {
    let all = (0..STEPS * STEPS).map(on_grid);
    all.map(|[as_one, shared_deg]| minus_log_likelihood(camera, as_one, shared_deg.to_radians())).collect()
}

/// Returns m and s (degrees) at a point of the grid. m starts at one step.
fn on_grid(at: usize) -> [f64; 2] {
    [STEP[0] * (at / STEPS + 1) as f64, STEP[1] * (at % STEPS) as f64]
}

/// Returns m and s at the least total cost of the cameras.
fn most_likely(cameras: &[&Vec<f64>]) -> [f64; 2] {
    let sum = |at: usize| cameras.iter().map(|costs| costs[at]).sum::<f64>();
    let best = (0..STEPS * STEPS).map(|at| (sum(at), at)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or([0.0; 2], |(_, at)| on_grid(at))
}

/// Returns minus the log likelihood. The covariance is diagonal plus one common direction (Sherman and Morrison).
fn minus_log_likelihood(camera: &CameraCars, as_one: f64, shared: f64) -> f64 {
    let common = shared * shared + camera.truth_sd * camera.truth_sd;
    let (mut information, mut pull, mut cost) = (0.0, 0.0, 0.0);
    for [error, claimed] in &camera.cars {
        let variance = as_one * claimed * claimed + 1e-12;
        information += 1.0 / variance;
        pull += error / variance;
        cost += 0.5 * (error * error / variance + variance.ln());
    }
    let more = 1.0 + common * information;
    cost + 0.5 * (more.ln() - common * pull * pull / more)
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_synth::Rng;

    #[test]
    fn the_true_sds_of_simulated_errors_are_found() {
        let mut random = Rng::new(3);
        let [claimed, shared] = [1.0_f64, 1.0].map(f64::to_radians);
        let cameras: Vec<Vec<f64>> = (0..300)
            .map(|_| {
                let truth_sd = 0.005;
                let common = shared.hypot(truth_sd) * random.normal();
                let car = |random: &mut Rng| [common + 4_f64.sqrt() * claimed * random.normal(), claimed];
                costs(&CameraCars { cars: (0..8).map(|_| car(&mut random)).collect(), truth_sd })
            })
            .collect();
        let found = most_likely(&cameras.iter().collect::<Vec<_>>());
        assert!((found[0] - 4.0).abs() <= 0.5 && (found[1] - 1.0).abs() <= 0.11, "{found:?}");
    }
}
