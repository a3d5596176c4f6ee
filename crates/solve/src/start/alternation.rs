//! Algorithm 1 of the paper *Car Pose in Context*: estimates focal length, ground plane and free poses alternately.
//!
//! The algorithm starts from poses with 6 degrees of freedom that were fitted at a wrong focal length.
//!
//! # Update of the focal length
//! Let f be the true focal length and `A x + B y + C z + D = 0` the true plane. Suppose that cars are fitted at a wrong
//! focal length `f' = λ f`. Then a car at (x, y, z) appears at `(x', y', z') = (x, y, λ z)`, and its rotation does not
//! change (paper §4.2). So the cars give two different planes, with normals v₁ and v₂:
//!
//! ```text
//! through the positions       A x' + B y' + (C/λ) z' + D = 0          v₁ ∝ (A, B, C/λ)
//! from the orientations       normal (A, B, C)                        v₂ ∝ (A, B, C)
//! ```
//!
//! Both normals are scaled so that their first two components agree. Their third components c₁ and c₂ then give
//!
//! ```text
//! λ = c₂ / c₁,   f = f' / λ = f' · c₁ / c₂
//! ```
//!
//! The paper prints the inverse of this ratio, which moves away from the truth. Scaling the normals to unit length
//! would be wrong, because λ would change their first two components too.

use nalgebra::{Matrix3, Vector3};

use crate::linear::lm::{LmOptions, minimise};
use crate::model::free::PlaneTerms;
use crate::problem::cars::FreeProblem;
use crate::start::up_consensus::camera_on;

/// Number of rounds of the alternation.
const ROUNDS: usize = 8;
/// Sds of the terms that pull the cars to a common plane, in the first round. From round to round they fall by a
/// constant factor.
const FIRST_TERMS: PlaneTerms = PlaneTerms { distance_sd_m: 1.5, angle_sd: 0.3 };
/// Sds of the terms that pull the cars to a common plane, in the last round.
pub(crate) const LAST_TERMS: PlaneTerms = PlaneTerms { distance_sd_m: 0.05, angle_sd: 0.01 };
/// Largest change of the logarithm of the focal length in one round.
const MAX_LOG_STEP: f64 = 0.5;
/// Limit below which a component of a plane's normal is too small to determine the focal length.
///
/// A nearly level camera has a small third component. A nearly vertical view has small first and second components.
const MIN_COMPONENT: f64 = 0.03;
/// Sd of the Gaussian that weights a car by its distance from a plane, as a fraction of the camera's height.
const POSITION_TOLERANCE: f64 = 0.15;
/// Sd of the Gaussian that weights a car's up direction by its angle to another up direction, rad.
const NORMAL_TOLERANCE: f64 = 0.2;
/// Largest number of triples of cars that are tried. Larger sets of triples are sampled evenly.
const MAX_TRIPLES: usize = 400;

/// Returns the ratio of the new focal length to the present one.
///
/// `by_positions` is the normal of the plane through the cars' positions. `by_orientations` is the normal from the
/// cars' orientations. Both point up. Returns `None` if they do not determine the focal length.
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

/// Returns the plane near which most cars are, as a vector v: points X on the plane satisfy `v · X + 1 = 0`.
///
/// Planes through three cars are tried in a fixed order, as in RANSAC. The best of them is then fitted to all cars near
/// it. Returns `None` if no triple defines a plane.
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
    // The normal v points to the camera's side: at the camera's centre X = 0, v · X + 1 is positive.
    plane.iter().all(|v| v.is_finite()).then_some(plane)
}

fn agreement(plane: &Vector3<f64>, position: &Vector3<f64>) -> f64 {
    let off = (plane.dot(position) + 1.0) / POSITION_TOLERANCE;
    (-0.5 * off * off).exp()
}

/// Returns the weighted mean of the cars' up directions; directions far from the majority get little weight.
pub(crate) fn common_up(ups: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let weight = |a: &Vector3<f64>, b: &Vector3<f64>| {
        (-0.5 * (a - b).norm_squared() / (NORMAL_TOLERANCE * NORMAL_TOLERANCE)).exp()
    };
    let support = |up: &Vector3<f64>| ups.iter().map(|other| weight(up, other)).sum::<f64>();
    let seed = ups.iter().max_by(|a, b| support(a).total_cmp(&support(b)))?;
    let sum: Vector3<f64> = ups.iter().map(|up| up * weight(seed, up)).sum();
    sum.try_normalize(1e-9)
}

/// Runs Algorithm 1 on a problem with free poses, and returns `false` if the cars define no plane.
///
/// Each round computes one plane from the cars' positions and one from their orientations, and updates the focal
/// length. Then it minimises the cost over poses and shapes. Soft terms pull the cars towards the plane, and become
/// stricter in each round.
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
        // Poses keep their parameters (u, v, ρ), so only the depths z change with the focal length, as §4.2 assumes.
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

    /// Returns the positions of cars that are fitted at a focal length λ times the true one (paper §4.2).
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
