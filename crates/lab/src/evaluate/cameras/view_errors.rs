//! How far off the view of cars is, each alone and all of a place together: what `solve.keypoints_as_one` and
//! `solve.shared_view_sd_deg` rest on.
//!
//! Error of car k before camera c: `e = b_c + d_k`, with d_k ~ N(0, m σ²), σ claimed with the car's misfit counted, and
//! b_c ~ N(0, s² + that of the truth). m and s are the most likely ones, by going through all of a grid.

use roadplane_tables::{Column, Table, bootstrap_scenes};

use super::measured::{Measured, counted};

/// Steps of the grid: of m, and of s in degrees; and how many.
const STEP: [f64; 2] = [0.5, 0.1];
const STEPS: usize = 41;

/// Errors (rad) and sds, keypoints taken for independent, of a camera's cars, and the sd of its truth.
struct Place {
    cars: Vec<[f64; 2]>,
    truth_sd: f64,
}

/// The table of both, for elevation and turn.
pub(super) fn table(measured: &[&Measured]) -> Table {
    let mut table = Table::new(
        "Errors of view",
        "Most likely: how many keypoints of a car are off together as one, and the sd of what the cars of a camera are off by \
         together. 95 % intervals by resampling cameras.",
        vec![Column::new("", 0), Column::new("keypoints as one", 1), Column::new("shared, °", 2)],
    );
    for (number, name) in ["elevation", "turn"].into_iter().enumerate() {
        let place = |m: &&Measured| Place {
            cars: counted(m).map(|car| [car.errors[number], car.claimed[number]]).collect(),
            truth_sd: m.camera.sd[number + 1],
        };
        let places: Vec<Vec<f64>> = measured.iter().map(|m| costs(&place(m))).collect();
        let of = |which: usize| bootstrap_scenes(&places, places.len(), |chosen| most_likely(chosen)[which]);
        table.rows.push(vec![name.into(), of(0).into(), of(1).into()]);
    }
    table
}

/// What a place costs (minus log likelihood) all over the grid.
fn costs(place: &Place) -> Vec<f64> {
    let all = (0..STEPS * STEPS).map(on_grid);
    all.map(|[as_one, shared_deg]| minus_log_likelihood(place, as_one, shared_deg.to_radians())).collect()
}

/// m and s (degrees) at a place of the grid; m from a step on.
fn on_grid(at: usize) -> [f64; 2] {
    [STEP[0] * (at / STEPS + 1) as f64, STEP[1] * (at % STEPS) as f64]
}

/// m and s where places together cost least.
fn most_likely(places: &[&Vec<f64>]) -> [f64; 2] {
    let sum = |at: usize| places.iter().map(|costs| costs[at]).sum::<f64>();
    let best = (0..STEPS * STEPS).map(|at| (sum(at), at)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or([0.0; 2], |(_, at)| on_grid(at))
}

/// Of a diagonal covariance with one direction in common, by Sherman and Morrison.
fn minus_log_likelihood(place: &Place, as_one: f64, shared: f64) -> f64 {
    let common = shared * shared + place.truth_sd * place.truth_sd;
    let (mut information, mut pull, mut cost) = (0.0, 0.0, 0.0);
    for [error, claimed] in &place.cars {
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
    fn sds_that_errors_were_drawn_with_are_found_again() {
        let mut random = Rng::new(3);
        let [claimed, shared] = [1.0_f64, 1.0].map(f64::to_radians);
        let places: Vec<Vec<f64>> = (0..300)
            .map(|_| {
                let truth_sd = 0.005;
                let common = shared.hypot(truth_sd) * random.normal();
                let car = |random: &mut Rng| [common + 4_f64.sqrt() * claimed * random.normal(), claimed];
                costs(&Place { cars: (0..8).map(|_| car(&mut random)).collect(), truth_sd })
            })
            .collect();
        let found = most_likely(&places.iter().collect::<Vec<_>>());
        assert!((found[0] - 4.0).abs() <= 0.5 && (found[1] - 1.0).abs() <= 0.11, "{found:?}");
    }
}
