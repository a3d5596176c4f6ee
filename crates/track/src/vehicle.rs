//! The motion model of a car: its rear axle moves where the car points, and its heading turns with the path.
//!
//! The state is (x, y, θ, v, κ): rear axle (m), heading (rad), speed (m/s, negative in reverse) and curvature of the
//! path (1/m). Two successive nodes are dt apart, and θ̄, v̄, κ̄ are the means of both. The residuals of one step are
//!
//! ```text
//! x' − x − v̄ dt cos θ̄ ~ SLIP_M
//! y' − y − v̄ dt sin θ̄ ~ SLIP_M
//! θ' − θ − v̄ κ̄ dt     ~ TURN
//! v' − v              ~ SPEED_CHANGE
//! κ' − κ              ~ CURVATURE_SD, less for long vehicles
//! ```
//!
//! Each residual has the variance sd² dt, with the sd named after the tilde. A stationary car (v = 0) keeps its position
//! and heading by the same equations. The measured point is the car's origin, which lies half a wheelbase l ahead:
//! `(x, y) + l (cos θ, sin θ)`.

use nalgebra::{Matrix3, Matrix3x5, Matrix5, Vector3, Vector5};
use roadplane_base::{StudentT, fold_axis};

use crate::{chain::Blocks, descent::descend, noise::VIEW_S};

/// The state (x, y, θ, v, κ) of a node: m, m, rad, m/s, 1/m.
pub(crate) type State = Vector5<f64>;

/// Distribution of a measurement's residuals. Half-hidden cars give some poses that are far off.
pub(crate) const SCATTER: StudentT = StudentT { dimensions: 3.0 };
/// Sd of the turning that the path does not explain, rad within 1 s.
const TURN: f64 = 0.02;
/// Sd of the sideways slip within 1 s, m. It grows with the square root of time.
const SLIP_M: f64 = 0.05;
/// Sd of the change of speed within 1 s, m/s. It grows with the square root of time.
const SPEED_CHANGE: f64 = 1.0;
/// Sd of the curvature of a car's path, 1/m, and of its change within 1 s, 1/m. The change grows with the square root of
/// time.
const CURVATURE_SD: f64 = 0.1;
/// Distance from the rear axle to a car's origin, m.
pub(crate) const HALF_WHEELBASE_M: f64 = 1.35;

/// A point of the path at which the state is estimated.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// Begin and end of the node, s. They differ for a stationary interval.
    pub span_s: [f64; 2],
    /// Measured origin (m) and heading (rad, modulo π), with the inverse of their covariance.
    pub measured: Option<(Vector3<f64>, Matrix3<f64>)>,
    /// Whether the car is stationary.
    pub parked: bool,
}

/// The least-squares problem of one path.
pub(crate) struct Vehicle<'a> {
    /// Nodes, in the order of time.
    pub nodes: &'a [Node],
    /// Distance from the rear axle to the vehicle's origin, m.
    pub half_wheelbase_m: f64,
}

/// Returns origin (m) and heading (rad) of a state, with their Jacobian by the state (3 × 5).
pub(crate) fn origin(state: &State, half_wheelbase_m: f64) -> (Vector3<f64>, Matrix3x5<f64>) {
    let (sin, cos) = state[2].sin_cos();
    let l = half_wheelbase_m;
    let pose = Vector3::new(state[0] + l * cos, state[1] + l * sin, state[2]);
    let mut jacobian = Matrix3x5::identity();
    (jacobian[(0, 2)], jacobian[(1, 2)]) = (-l * sin, l * cos);
    (pose, jacobian)
}

/// Returns the state whose origin (m) and heading (rad) are these. Its curvature is 0.
pub(crate) fn state_at(origin: &Vector3<f64>, speed_mps: f64, half_wheelbase_m: f64) -> State {
    let (sin, cos) = origin.z.sin_cos();
    let l = half_wheelbase_m;
    State::new(origin.x - l * cos, origin.y - l * sin, origin.z, speed_mps, 0.0)
}

/// Returns the residual of a measured pose (x, y, heading), m and rad. Headings are compared modulo π.
pub(crate) fn residual(measured: &Vector3<f64>, pose: &Vector3<f64>) -> Vector3<f64> {
    let d = measured - pose;
    Vector3::new(d.x, d.y, fold_axis(d.z))
}

/// Returns the states after a step.
pub(crate) fn moved(states: &[State], step: &[State]) -> Vec<State> {
    states.iter().zip(step).map(|(state, step)| state + step).collect()
}

impl Vehicle<'_> {
    /// Solves the problem. Returns the states and their covariances, or `None` where the problem is singular.
    pub(crate) fn solve(&self, start: Vec<State>) -> Option<(Vec<State>, Vec<Matrix5<f64>>)> {
        let states = descend(
            start,
            |states| Some(self.cost(states)),
            |states| Some(self.blocks(states)),
            |states, blocks, damping| Some(moved(states, &blocks.step(damping)?)),
        )?;
        let covariances = self.blocks(&states).covariances()?;
        Some((states, covariances))
    }

    /// Returns the negative log posterior of the states, up to a constant.
    pub(crate) fn cost(&self, states: &[State]) -> f64 {
        let mut total = 0.0;
        for (i, (node, state)) in self.nodes.iter().zip(states).enumerate() {
            if let Some((measured, information)) = &node.measured {
                let d = residual(measured, &origin(state, self.half_wheelbase_m).0);
                total += SCATTER.cost(d.dot(&(information * d)));
            }
            let precision = self.prior(i);
            total += 0.5 * state.component_mul(state).dot(&precision);
        }
        for i in 1..states.len() {
            let dt = self.gap_s(i);
            let (r, _, _) = step_residual(&states[i - 1], &states[i], dt);
            total += 0.5 * r.component_mul(&r).dot(&self.step_precision(dt));
        }
        total
    }

    /// Returns the second-order expansion of the negative log posterior about the states.
    pub(crate) fn blocks(&self, states: &[State]) -> Blocks {
        let mut blocks = Blocks::zeros(states.len());
        for (i, (node, state)) in self.nodes.iter().zip(states).enumerate() {
            if let Some((measured, information)) = &node.measured {
                let (pose, jacobian) = origin(state, self.half_wheelbase_m);
                let d = residual(measured, &pose);
                let weight = SCATTER.weight(d.dot(&(information * d)));
                let weighted = jacobian.transpose() * information * weight;
                blocks.diagonal[i] += weighted * jacobian;
                blocks.gradient[i] -= weighted * d;
            }
            let precision = self.prior(i);
            blocks.diagonal[i] += Matrix5::from_diagonal(&precision);
            blocks.gradient[i] += precision.component_mul(state);
        }
        for i in 1..states.len() {
            let dt = self.gap_s(i);
            let (r, from, to) = step_residual(&states[i - 1], &states[i], dt);
            let precision = Matrix5::from_diagonal(&self.step_precision(dt));
            blocks.diagonal[i - 1] += from.transpose() * precision * from;
            blocks.diagonal[i] += to.transpose() * precision * to;
            blocks.upper[i - 1] += from.transpose() * precision * to;
            blocks.gradient[i - 1] += from.transpose() * precision * r;
            blocks.gradient[i] += to.transpose() * precision * r;
        }
        blocks
    }

    /// Returns the curvature of this vehicle's paths relative to those of cars. The wheels of all vehicles turn by the
    /// same angles, which makes a long vehicle's path less curved.
    fn relative_curvature(&self) -> f64 {
        HALF_WHEELBASE_M / self.half_wheelbase_m
    }

    /// Returns the time between the node before `to` and the node `to`, s. Beyond an end of the path, it is 1 ms.
    fn gap_s(&self, to: usize) -> f64 {
        let ends = to.checked_sub(1).and_then(|from| Some((self.nodes.get(from)?, self.nodes.get(to)?)));
        ends.map_or(0.0, |(from, to)| to.span_s[0] - from.span_s[1]).max(1e-3)
    }

    /// Returns the precisions of the prior of a node's state, whose mean is 0. No path curves like a corkscrew, no road
    /// car drives 60 m/s, and a stationary car has no speed. All nodes within [`VIEW_S`] share one prior of the
    /// curvature.
    fn prior(&self, i: usize) -> State {
        let speed: f64 = if self.nodes[i].parked { 1e-3 } else { 30.0 };
        let curvature = CURVATURE_SD * self.relative_curvature();
        let around_s = self.gap_s(i) + self.gap_s(i + 1);
        let share = (around_s / (2.0 * VIEW_S)).min(1.0);
        State::new(0.0, 0.0, 0.0, speed.powi(-2), share * curvature.powi(-2))
    }

    /// Returns the precisions of a step's residual over a time in s.
    fn step_precision(&self, dt: f64) -> State {
        let sd = [SLIP_M, SLIP_M, TURN, SPEED_CHANGE, CURVATURE_SD * self.relative_curvature()];
        State::from_fn(|i, _| 1.0 / (sd[i] * sd[i] * dt))
    }
}

/// Returns the residual of a step and its Jacobians (5 × 5) by the state before and the state after.
fn step_residual(a: &State, b: &State, dt: f64) -> (State, Matrix5<f64>, Matrix5<f64>) {
    let (heading, speed, curvature) = ((a[2] + b[2]) / 2.0, (a[3] + b[3]) / 2.0, (a[4] + b[4]) / 2.0);
    let (sin, cos) = heading.sin_cos();
    let distance = speed * dt;
    let mut r = b - a;
    r[0] -= distance * cos;
    r[1] -= distance * sin;
    r[2] -= distance * curvature;
    // Derivatives by the means, half of which each end makes up.
    let mut half = Matrix5::zeros();
    half[(0, 2)] = distance * sin / 2.0;
    half[(1, 2)] = -distance * cos / 2.0;
    half[(0, 3)] = -dt * cos / 2.0;
    half[(1, 3)] = -dt * sin / 2.0;
    half[(2, 3)] = -dt * curvature / 2.0;
    half[(2, 4)] = -distance / 2.0;
    (r, half - Matrix5::identity(), half + Matrix5::identity())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Generates states within ±9 m, ±3 rad, ±9 m/s and ±0.3 1/m.
    fn state() -> impl Strategy<Value = State> {
        [-9.0f64..9.0, -9.0..9.0, -3.0..3.0, -9.0..9.0, -0.3..0.3].prop_map(|v| State::from_row_slice(&v))
    }

    proptest! {
        #[test]
        fn jacobians_are_derivatives(a in state(), b in state(), dt in 0.01f64..0.5) {
            let (_, from, to) = step_residual(&a, &b, dt);
            let (_, out) = origin(&a, 1.35);
            for i in 0..5 {
                let mut h = State::zeros();
                h[i] = 1e-6;
                let by_a = (step_residual(&(a + h), &b, dt).0 - step_residual(&(a - h), &b, dt).0) / 2e-6;
                let by_b = (step_residual(&a, &(b + h), dt).0 - step_residual(&a, &(b - h), dt).0) / 2e-6;
                let by_origin = (origin(&(a + h), 1.35).0 - origin(&(a - h), 1.35).0) / 2e-6;
                prop_assert!((by_a - from.column(i)).norm() < 1e-7);
                prop_assert!((by_b - to.column(i)).norm() < 1e-7);
                prop_assert!((by_origin - out.column(i)).norm() < 1e-7);
            }
        }
    }
}
