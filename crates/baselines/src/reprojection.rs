//! The reprojection error of one car as a least-squares problem for the solver of the crate `solve`. The unknowns are
//! the pose and shape of the car.
//!
//! ```text
//! E = Σ_i ½ w_i ‖π(R S_i(c) + T) − z_i‖² / σ² + ½ ‖c‖²         π(X) = X_xy / X_z, for a focal length of 1
//! ```
//!
//! The sum is over the observed keypoints i, with image points z_i, weights w_i and the sd σ. R and T are the rotation
//! and translation of the car. S_i(c) is the point of the car with the shape coefficients c.
//!
//! A step is `(ω, δT, δc)` with `R ← exp(ω) R`. So with X = R S + T, the Jacobian of a residual is
//! `∂π/∂X · [−[R S]×, I, R V_1 … R V_6]`. V_j is the vector of shape mode j at the keypoint.

use nalgebra::{Matrix2x3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};
use roadplane_base::{MODES, Shape, ShapeAtlas};
use roadplane_solve::{Problem, Trial};

use crate::evidence::Observation;

/// Number of unknowns: three of the rotation, three of the translation, and the shape coefficients.
const UNKNOWNS: usize = 6 + MODES;
/// Least depth of a point that can be projected, m.
const MIN_DEPTH_M: f64 = 0.1;

/// State of the problem: pose and shape of the car.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State {
    pub camera_from_car: UnitQuaternion<f64>,
    pub translation: Vector3<f64>,
    pub shape: Shape,
}

/// The least-squares problem with its current state.
pub(crate) struct Reprojection<'a> {
    atlas: &'a ShapeAtlas,
    observations: &'a [Observation],
    /// The weights w_i. The caller may change them between runs of the solver.
    pub weights: Vec<f64>,
    /// The sd σ of a keypoint, in units of the focal length.
    pub sigma: f64,
    /// Whether the shape coefficients c are unknowns, too.
    pub shape_free: bool,
    pub state: State,
    trial: State,
    cost: f64,
    normal: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    gradient: SVector<f64, UNKNOWNS>,
}

impl<'a> Reprojection<'a> {
    pub fn new(atlas: &'a ShapeAtlas, observations: &'a [Observation], sigma: f64, state: State) -> Self {
        Self {
            atlas,
            observations,
            weights: observations.iter().map(|s| s.weight).collect(),
            sigma,
            shape_free: false,
            state,
            trial: state,
            cost: f64::INFINITY,
            normal: SMatrix::zeros(),
            gradient: SVector::zeros(),
        }
    }

    /// Returns the unweighted residual of each observation, in units of σ. Returns `None` if a point lies behind the
    /// camera or very close to it.
    pub fn residuals(&self, state: &State) -> Option<Vec<Vector2<f64>>> {
        let residual = |s: &Observation| {
            let x =
                state.camera_from_car * self.atlas.keypoint_in_car(s.index, &state.shape) + state.translation;
            (x.z > MIN_DEPTH_M).then(|| (x.xy() / x.z - s.xy()) / self.sigma)
        };
        self.observations.iter().map(residual).collect()
    }

    fn cost_at(&self, state: &State) -> Option<f64> {
        let residuals = self.residuals(state)?;
        let data: f64 = residuals.iter().zip(&self.weights).map(|(r, w)| w * r.norm_squared()).sum();
        let cost = 0.5 * data + 0.5 * state.shape.norm_squared();
        cost.is_finite().then_some(cost)
    }
}

impl Problem for Reprojection<'_> {
    fn linearise(&mut self) -> Option<f64> {
        self.cost = self.cost_at(&self.state)?;
        self.normal.fill(0.0);
        self.gradient.fill(0.0);
        let state = &self.state;
        for (s, weight) in self.observations.iter().zip(&self.weights) {
            let turned = state.camera_from_car * self.atlas.keypoint_in_car(s.index, &state.shape);
            let x = turned + state.translation;
            let projected = x.xy() / x.z;
            let by_point =
                Matrix2x3::new(1.0, 0.0, -projected.x, 0.0, 1.0, -projected.y) / (x.z * self.sigma);
            let mut jacobian = SMatrix::<f64, 2, UNKNOWNS>::zeros();
            jacobian.fixed_view_mut::<2, 3>(0, 0).copy_from(&(-by_point * turned.cross_matrix()));
            jacobian.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_point);
            if self.shape_free {
                for (j, mode) in self.atlas.modes.iter().enumerate() {
                    let column = by_point * (state.camera_from_car * mode[s.index]);
                    jacobian.set_column(6 + j, &column);
                }
            }
            let residual = (projected - s.xy()) / self.sigma;
            self.normal += jacobian.transpose() * jacobian * *weight;
            self.gradient += jacobian.transpose() * residual * *weight;
        }
        for j in 0..MODES {
            self.normal[(6 + j, 6 + j)] += 1.0;
            self.gradient[6 + j] += if self.shape_free { state.shape[j] } else { 0.0 };
        }
        let scaled = |i: usize| self.gradient[i].abs() / self.normal[(i, i)].max(1e-300).sqrt();
        Some((0..UNKNOWNS).map(scaled).fold(0.0, f64::max))
    }

    fn cost(&self) -> f64 {
        self.cost
    }

    fn try_step(&mut self, damping: f64) -> Option<Trial> {
        let mut damped = self.normal;
        for i in 0..UNKNOWNS {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = -damped.cholesky()?.solve(&self.gradient);
        let part = |from: usize| step.fixed_rows::<3>(from).into_owned();
        self.trial = State {
            camera_from_car: UnitQuaternion::from_scaled_axis(part(0)) * self.state.camera_from_car,
            translation: self.state.translation + part(3),
            shape: self.state.shape + step.fixed_rows::<MODES>(6),
        };
        let cost = self.cost_at(&self.trial)?;
        let predicted = -step.dot(&self.gradient) - 0.5 * step.dot(&(self.normal * step));
        let moved = part(3).norm() / self.state.translation.norm();
        let step_size = part(0).norm().max(moved).max(step.fixed_rows::<MODES>(6).amax());
        Some(Trial { cost, predicted_decrease: predicted, step_size })
    }

    fn accept(&mut self) -> Option<f64> {
        self.state = self.trial;
        self.linearise()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn the_gradient_equals_that_of_the_cost() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let state = State {
            camera_from_car: UnitQuaternion::from_euler_angles(1.4, 0.3, -0.8),
            translation: Vector3::new(1.0, -0.5, 14.0),
            shape: Shape::new(0.5, -1.0, 0.2, 0.0, 1.5, -0.3),
        };
        let observation = |index: usize| Observation {
            index,
            ray: Vector3::new(0.01 * index as f64, 0.2 - 0.005 * index as f64, 1.0),
            weight: 0.3 + 0.02 * index as f64,
        };
        let observations: Vec<Observation> = (0..20).map(observation).collect();
        let mut problem = Reprojection::new(&atlas, &observations, 0.01, state);
        problem.shape_free = true;
        problem.linearise().unwrap();
        for i in 0..UNKNOWNS {
            let moved = |by: f64| {
                let mut step = SVector::<f64, UNKNOWNS>::zeros();
                step[i] = by;
                let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
                let state = State {
                    camera_from_car: turn * state.camera_from_car,
                    translation: state.translation + step.fixed_rows::<3>(3),
                    shape: state.shape + step.fixed_rows::<MODES>(6),
                };
                problem.cost_at(&state).unwrap()
            };
            let numeric = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            let analytic = problem.gradient[i];
            assert!(
                (numeric - analytic).abs() <= 1e-6 * problem.gradient.amax(),
                "{i}: {numeric} {analytic}"
            );
        }
    }
}
