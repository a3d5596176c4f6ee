//! How far off the view of cars is, each alone and all of a place together: what `solve.view_sd_deg` and
//! `solve.shared_view_sd_deg` rest on.
//!
//! Error of car k before camera c: `e = b_c + d_k + n_k`, with n_k as claimed, d_k ~ N(0, σ²), b_c ~ N(0, s² + that of the truth).
//! σ and s are the most likely ones, by going through all of a grid.

use roadplane_tables::{Column, Table, bootstrap_scenes};

use super::measured::{Measured, counted};

/// Steps of the grid, degrees, and how many.
const STEP_DEG: f64 = 0.1;
const STEPS: usize = 41;

/// Errors (rad) and claimed sds of a camera's cars, and the sd of its truth.
struct Place {
    cars: Vec<[f64; 2]>,
    truth_sd: f64,
}

/// The table of both, for elevation and turn.
pub(super) fn table(measured: &[&Measured]) -> Table {
    let mut table = Table::new(
        "Errors of view",
        "Most likely sds of what single cars are off by beside what their keypoints claim, and of what the cars of a camera share. \
         95 % intervals by resampling cameras.",
        vec![Column::new("", 0), Column::new("of a car, °", 2), Column::new("shared, °", 2)],
    );
    for (number, name) in ["elevation", "turn"].into_iter().enumerate() {
        let place = |m: &&Measured| Place {
            cars: counted(m).map(|car| [car.errors[number], car.claimed[number]]).collect(),
            truth_sd: m.camera.sd[number + 1],
        };
        let places: Vec<Vec<f64>> = measured.iter().map(|m| costs(&place(m))).collect();
        let of = |which: usize| {
            bootstrap_scenes(&places, places.len(), |chosen| STEP_DEG * most_likely(chosen)[which] as f64)
        };
        table.rows.push(vec![name.into(), of(0).into(), of(1).into()]);
    }
    table
}

/// What a place costs (minus log likelihood) all over the grid: of a car, shared.
fn costs(place: &Place) -> Vec<f64> {
    let angle = |steps: usize| (STEP_DEG * steps as f64).to_radians();
    let all = (0..STEPS).flat_map(|own| (0..STEPS).map(move |shared| [own, shared]));
    all.map(|[own, shared]| minus_log_likelihood(place, angle(own), angle(shared))).collect()
}

/// Steps on the grid where places together cost least.
fn most_likely(places: &[&Vec<f64>]) -> [usize; 2] {
    let sum = |at: usize| places.iter().map(|costs| costs[at]).sum::<f64>();
    let best = (0..STEPS * STEPS).map(|at| (sum(at), at)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or([0, 0], |(_, at)| [at / STEPS, at % STEPS])
}

/// Of a diagonal covariance with one direction in common, by Sherman and Morrison.
fn minus_log_likelihood(place: &Place, own: f64, shared: f64) -> f64 {
    let common = shared * shared + place.truth_sd * place.truth_sd;
    let (mut information, mut pull, mut cost) = (0.0, 0.0, 0.0);
    for [error, claimed] in &place.cars {
        let variance = claimed * claimed + own * own + 1e-12;
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
        let [own, shared] = [2.0_f64, 1.0].map(f64::to_radians);
        let places: Vec<Vec<f64>> = (0..300)
            .map(|_| {
                let truth_sd = 0.005;
                let common = shared.hypot(truth_sd) * random.normal();
                let car = |random: &mut Rng| [common + own.hypot(0.01) * random.normal(), 0.01];
                costs(&Place { cars: (0..8).map(|_| car(&mut random)).collect(), truth_sd })
            })
            .collect();
        let found = most_likely(&places.iter().collect::<Vec<_>>());
        assert!(found[0].abs_diff(20) <= 1 && found[1].abs_diff(10) <= 1, "{found:?}");
    }
}
