//! The paper's Algorithm 1: finds consistent focal length, plane and poses from free poses at a wrong focal length.
//!
//! # The focal update
//! Let the true focal length be f and the plane `A x + B y + C z + D = 0`. At `f' = λ f` the same images put every car
//! at `(x, y, λ z)` with its rotation unchanged (paper §4.2). So
//!
//! ```text
//! plane through positions      A x' + B y' + (C/λ) z' + D = 0          v¹ ∝ (A, B, C/λ)
//! plane from orientations      normal (A, B, C)                        v² ∝ (A, B, C)
//! ```
//!
//! Scaled to the same (a, b), the third components give `λ = v²_c / v¹_c`, and so `f = f' / λ = f' · v¹_c / v²_c`. The
//! paper prints the inverse, which moves away from the truth. Normalising to unit length would mix λ into (a, b).

use nalgebra::{Matrix3, Vector3};

use crate::linear::lm::{LmOptions, minimise};
use crate::model::free::PlaneTerms;
use crate::problem::cars::FreeProblem;
use crate::start::up_consensus::camera_on;

/// Number of rounds of the alternation.
const ROUNDS: usize = 8;
/// Soft terms of the first round. Between first and last round, μ₁ and μ₂ grow geometrically.
const FIRST_TERMS: PlaneTerms = PlaneTerms { distance_sd_m: 1.5, angle_sd: 0.3 };
/// Soft terms of the last round.
pub(crate) const LAST_TERMS: PlaneTerms = PlaneTerms { distance_sd_m: 0.05, angle_sd: 0.01 };
/// Largest change of log f in a round.
const MAX_LOG_STEP: f64 = 0.5;
/// Least |c| and least length of (a, b) at which a plane determines the focal length.
///
/// A smaller |c| means a nearly level camera, and a shorter (a, b) means a nearly vertical view.
const MIN_COMPONENT: f64 = 0.03;
/// Sd of the Gaussian weight that a car gets by its distance from a plane, as a share of the camera's height.
const POSITION_TOLERANCE: f64 = 0.15;
/// Sd of the Gaussian weight that a normal gets by its angle to another normal, rad.
const NORMAL_TOLERANCE: f64 = 0.2;
/// Largest number of triples of cars that are tried, at equal strides over all triples.
const MAX_TRIPLES: usize = 400;

/// Returns `f_new / f` from the plane through positions and the normal from orientations, both pointing up.
///
/// Returns `None` if the geometry does not determine the focal length.
pub(crate) fn focal_factor(by_positions: &Vector3<f64>, by_orientations: &Vector3<f64>) -> Option<f64> {
    let c = |v: &Vector3<f64>| {
        let ab = v.xy().norm();
        (ab > MIN_COMPONENT * v.norm()).then(|| v.z / ab)
    };
    let (c1, c2) = (c(by_positions)?, c(by_orientations)?);
    let factor = c1 / c2;
    (c1.abs() > MIN_COMPONENT && c2.abs() > MIN_COMPONENT && factor > 0.0 && factor.is_finite())
        .then(|| factor.clamp((-MAX_LOG_STEP).exp(), MAX_LOG_STEP.exp()))
}

/// Returns the plane on which most cars are, scaled so that `v · X + 1 = 0`, by RANSAC over triples in a fixed order.
///
/// The plane is then fitted to the cars on it. Returns `None` if no triple defines a plane.
pub(crate) fn plane_through(positions: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let n = positions.len();
    let triples = n * n.saturating_sub(1) * n.saturating_sub(2) / 6;
    let stride = triples.div_ceil(MAX_TRIPLES).max(1);
    let mut best: Option<(f64, Vector3<f64>)> = None;
    let mut turn = 0;
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                turn += 1;
                if turn % stride != 0 {
                    continue;
                }
                let rows = Matrix3::from_columns(&[i, j, k].map(|car| positions[car])).transpose();
                let Some(inverse) = rows.try_inverse() else { continue };
                let plane = -(inverse * Vector3::repeat(1.0));
                let score: f64 = positions.iter().map(|p| agreement(&plane, p)).sum();
                if plane.iter().all(|v| v.is_finite()) && best.is_none_or(|(most, _)| score > most) {
                    best = Some((score, plane));
                }
            }
        }
    }
    let (_, mut plane) = best?;
    for _ in 0..5 {
        let (mut normal, mut side) = (Matrix3::zeros(), Vector3::zeros());
        for p in positions {
            // Depth errors grow with depth, so each car is weighted by its distance.
            let weight = agreement(&plane, p) / p.norm_squared();
            normal += p * p.transpose() * weight;
            side -= p * weight;
        }
        plane = normal.cholesky()?.solve(&side);
    }
    // The camera is above the plane, because v · 0 + 1 > 0 for its centre.
    plane.iter().all(|v| v.is_finite()).then_some(plane)
}

fn agreement(plane: &Vector3<f64>, position: &Vector3<f64>) -> f64 {
    let off = (plane.dot(position) + 1.0) / POSITION_TOLERANCE;
    (-0.5 * off * off).exp()
}

/// Returns the mean up direction of the cars that agree with most others.
pub(crate) fn common_up(ups: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let weight = |a: &Vector3<f64>, b: &Vector3<f64>| {
        (-0.5 * (a - b).norm_squared() / (NORMAL_TOLERANCE * NORMAL_TOLERANCE)).exp()
    };
    let support = |up: &Vector3<f64>| ups.iter().map(|other| weight(up, other)).sum::<f64>();
    let seed = ups.iter().max_by(|a, b| support(a).total_cmp(&support(b)))?;
    let sum: Vector3<f64> = ups.iter().map(|up| up * weight(seed, up)).sum();
    sum.try_normalize(1e-9)
}

/// Runs Algorithm 1 in place, and returns `false` if the cars define no plane.
///
/// A round computes planes from positions and from orientations, updates the focal length, and minimises the poses with
/// soft terms that grow from round to round.
pub(crate) fn alternate(problem: &mut FreeProblem<'_>, lm: &LmOptions) -> bool {
    let focal_given = problem.knowledge.fixed[0];
    let fixed = problem.knowledge.fixed;
    problem.knowledge.fixed = [true; 4];
    let short = LmOptions { max_iterations: 8, cost_tolerance: 1e-3, step_tolerance: 1e-2, ..*lm };
    let mut ok = false;
    for round in 0..ROUNDS {
        let focal_px = problem.state.camera[0].exp();
        let cars = &problem.state.poses;
        let ups: Vec<Vector3<f64>> = cars.iter().map(|car| car.camera_from_car * Vector3::z()).collect();
        let positions: Vec<Vector3<f64>> = cars.iter().map(|car| car.origin(focal_px)).collect();
        let Some(up) = common_up(&ups) else { break };
        let factor = plane_through(&positions).and_then(|plane| focal_factor(&plane, &up));
        let focal_px = if focal_given { focal_px } else { focal_px * factor.unwrap_or(1.0) };
        // (u, v, ρ) do not change, so the cars move to (x, y, λ z), as the update assumes.
        let positions = cars.iter().map(|car| car.origin(focal_px));
        let Some(camera) = camera_on(focal_px, &up, positions) else { break };
        problem.state.camera = camera;
        let share = round as f64 / (ROUNDS - 1) as f64;
        let between = |first: f64, last: f64| first * (last / first).powf(share);
        problem.plane = Some(PlaneTerms {
            distance_sd_m: between(FIRST_TERMS.distance_sd_m, LAST_TERMS.distance_sd_m),
            angle_sd: between(FIRST_TERMS.angle_sd, LAST_TERMS.angle_sd),
        });
        problem.shapes_fixed = true;
        minimise(problem, &short);
        problem.shapes_fixed = false;
        minimise(problem, &short);
        ok = true;
    }
    problem.knowledge.fixed = fixed;
    ok
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::GroundPlane;

    /// Returns positions of cars at a focal length that is wrong by the factor λ, as the paper assumes.
    fn positions_at(plane: &GroundPlane, lambda: f64) -> Vec<Vector3<f64>> {
        let camera_from_world = plane.camera_from_world();
        let at = |x: f64, y: f64| (camera_from_world * nalgebra::Point3::new(x, y, 0.0)).coords;
        [at(-8.0, 30.0), at(5.0, 25.0), at(2.0, 60.0), at(-15.0, 55.0), at(9.0, 41.0)]
            .map(|p| Vector3::new(p.x, p.y, lambda * p.z))
            .to_vec()
    }

    #[test]
    fn the_step_lands_on_the_truth_and_the_printed_one_moves_away() {
        for tilt in [0.1_f64, 0.3, 0.6, 1.0] {
            for roll in [-0.1, 0.0, 0.1] {
                for lambda in [0.7_f64, 0.9, 1.1, 1.4] {
                    let plane = GroundPlane::from_tilt_roll_height(tilt, roll, 8.0);
                    let by_positions = plane_through(&positions_at(&plane, lambda)).unwrap();
                    let factor = focal_factor(&by_positions, &plane.normal_in_camera).unwrap();
                    let wrong = lambda.ln().abs();
                    assert!((factor * lambda).ln().abs() < 1e-6, "f' = λ f becomes f: {factor} × {lambda}");
                    assert!((lambda / factor).ln().abs() > 1.9 * wrong, "the printed v²/v¹ moves away");
                }
            }
        }
    }

    #[test]
    fn one_car_off_the_plane_is_outvoted() {
        let plane = GroundPlane::from_tilt_roll_height(0.4, 0.02, 8.0);
        let mut positions = positions_at(&plane, 1.0);
        positions.push(Vector3::new(0.0, -6.0, 20.0));
        let found = plane_through(&positions).unwrap();
        assert!((found / found.norm() - plane.normal_in_camera).norm() < 1e-4);
    }

    #[test]
    fn degenerate_geometry_gives_no_step() {
        let level = Vector3::new(0.0, -1.0, 0.0);
        let down = Vector3::new(0.0, 0.0, -1.0);
        assert!(focal_factor(&level, &level).is_none());
        assert!(focal_factor(&down, &down).is_none());
        assert!(focal_factor(&Vector3::new(0.0, -1.0, 0.5), &Vector3::new(0.0, -1.0, -0.5)).is_none());
        assert!(plane_through(&[Vector3::z(), Vector3::z(), Vector3::z()]).is_none());
    }
}
