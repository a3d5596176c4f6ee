//! How a car moves: its rear axle goes where the car points, its heading turns with the path.
//!
//! State (x, y, θ, v, κ): rear axle (m), heading (rad), speed (m/s, negative when reversing), curvature of the path (1/m).
//! From one node to the next, dt apart, with means θ̄, v̄, κ̄ of both ends:
//!
//! ```text
//! x' − x − v̄ dt cos θ̄ ~ slip,   y' − y − v̄ dt sin θ̄ ~ slip,   θ' − θ − v̄ κ̄ dt ~ 0,   v' − v ~ speed_change,   κ' − κ ~ curvature_change
//! ```
//!
//! each with variance sd² dt. A car that stands (v = 0) keeps place and heading by the same equations. The car's origin,
//! which is measured, lies half a wheelbase ahead: `(x, y) + l (cos θ, sin θ)`.

use nalgebra::{Matrix3, Matrix3x5, Matrix5, Vector3, Vector5};
use roadplane_base::{StudentT, fold_axis};

use crate::{TrackOptions, chain::Blocks};

pub(crate) type State = Vector5<f64>;

/// How measurements scatter.
const SCATTER: StudentT = StudentT { dimensions: 3.0 };
/// Least sd of a step, in the state's units: a straight drive is not exactly straight.
const STEP_FLOOR: [f64; 5] = [1e-3, 1e-3, 1e-4, 1e-3, 1e-4];
/// Turning that the path does not explain, rad within 1 s.
const TURN: f64 = 0.02;
/// Speed of a standing car, m/s.
const STANDING: f64 = 1e-3;
/// Weight of the curvature's prior in one node: neighbouring nodes share it.
const BEND_WEIGHT: f64 = 0.05;
const MAX_ROUNDS: usize = 40;

/// A time at which the state is asked for.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// When it begins and ends; a stand lasts.
    pub span_s: [f64; 2],
    /// Origin and heading (modulo π) with the inverse of their covariance.
    pub measured: Option<(Vector3<f64>, Matrix3<f64>)>,
    pub parked: bool,
}

pub(crate) struct Vehicle<'a> {
    pub nodes: &'a [Node],
    pub options: &'a TrackOptions,
}

/// Origin and heading of a state, with the Jacobian (3 × 5).
pub(crate) fn origin(state: &State, half_wheelbase_m: f64) -> (Vector3<f64>, Matrix3x5<f64>) {
    let (sin, cos) = state[2].sin_cos();
    let l = half_wheelbase_m;
    let pose = Vector3::new(state[0] + l * cos, state[1] + l * sin, state[2]);
    let jacobian = Matrix3x5::new(
        1.0,
        0.0,
        -l * sin,
        0.0,
        0.0, //
        0.0,
        1.0,
        l * cos,
        0.0,
        0.0, //
        0.0,
        0.0,
        1.0,
        0.0,
        0.0,
    );
    (pose, jacobian)
}

/// The state whose origin is there.
pub(crate) fn state_at(origin: &Vector3<f64>, speed_mps: f64, half_wheelbase_m: f64) -> State {
    let (sin, cos) = origin.z.sin_cos();
    let l = half_wheelbase_m;
    State::new(origin.x - l * cos, origin.y - l * sin, origin.z, speed_mps, 0.0)
}

/// Residual of a measurement; its heading is an axis.
pub(crate) fn residual(state: &State, measured: &Vector3<f64>, half_wheelbase_m: f64) -> Vector3<f64> {
    let d = measured - origin(state, half_wheelbase_m).0;
    Vector3::new(d.x, d.y, fold_axis(d.z))
}

impl Vehicle<'_> {
    /// Levenberg–Marquardt from a start; the states that it reaches and their covariances.
    pub(crate) fn solve(&self, start: Vec<State>) -> Option<(Vec<State>, Vec<Matrix5<f64>>)> {
        let mut states = start;
        let mut cost = self.cost(&states);
        let mut damping = 1e-6;
        for _ in 0..MAX_ROUNDS {
            let blocks = self.blocks(&states);
            let mut gained = None;
            while damping < 1e9 {
                if let Some(step) = blocks.step(damping) {
                    let trial: Vec<State> = states.iter().zip(&step).map(|(s, d)| s + d).collect();
                    let reached = self.cost(&trial);
                    if reached <= cost {
                        gained = Some(cost - reached);
                        (states, cost) = (trial, reached);
                        damping = (damping * 0.1).max(1e-9);
                        break;
                    }
                }
                damping *= 10.0;
            }
            match gained {
                Some(gain) if gain > 1e-9 * (1.0 + cost) => {}
                _ => break,
            }
        }
        let covariances = self.blocks(&states).covariances()?;
        Some((states, covariances))
    }

    /// Negative log posterior of states, up to a constant.
    pub(crate) fn cost(&self, states: &[State]) -> f64 {
        let mut total = 0.0;
        for (node, state) in self.nodes.iter().zip(states) {
            if let Some((measured, information)) = &node.measured {
                let d = residual(state, measured, self.options.half_wheelbase_m);
                total += SCATTER.cost(d.dot(&(information * d)));
            }
            let precision = self.prior(node);
            total += 0.5 * state.component_mul(state).dot(&precision);
        }
        for i in 1..states.len() {
            let dt = self.gap_s(i);
            let (r, _, _) = step_residual(&states[i - 1], &states[i], dt);
            total += 0.5 * r.component_mul(&r).dot(&self.step_precision(dt));
        }
        total
    }

    /// The same to second order about them.
    pub(crate) fn blocks(&self, states: &[State]) -> Blocks {
        let mut blocks = Blocks::zeros(states.len());
        for (i, (node, state)) in self.nodes.iter().zip(states).enumerate() {
            if let Some((measured, information)) = &node.measured {
                let (_, jacobian) = origin(state, self.options.half_wheelbase_m);
                let d = residual(state, measured, self.options.half_wheelbase_m);
                let weight = SCATTER.weight(d.dot(&(information * d)));
                let weighted = jacobian.transpose() * information * weight;
                blocks.diagonal[i] += weighted * jacobian;
                blocks.gradient[i] -= weighted * d;
            }
            let precision = self.prior(node);
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

    fn gap_s(&self, to: usize) -> f64 {
        (self.nodes[to].span_s[0] - self.nodes[to - 1].span_s[1]).max(1e-3)
    }

    /// Precisions of what is believed of a state by itself: no path bends like a corkscrew, no road car does 60 m/s, and a
    /// standing car stands.
    fn prior(&self, node: &Node) -> State {
        let speed = if node.parked { STANDING } else { 30.0 };
        let bend = self.options.curvature_sd;
        State::new(0.0, 0.0, 0.0, speed.powi(-2), BEND_WEIGHT * bend.powi(-2))
    }

    fn step_precision(&self, dt: f64) -> State {
        let o = self.options;
        let sd = [o.slip_m, o.slip_m, TURN, o.speed_change, o.curvature_change];
        State::from_fn(|i, _| 1.0 / (sd[i] * sd[i] * dt + STEP_FLOOR[i] * STEP_FLOOR[i]))
    }
}

/// Residual of a step and its Jacobians (5 × 5) by the states before and after.
fn step_residual(a: &State, b: &State, dt: f64) -> (State, Matrix5<f64>, Matrix5<f64>) {
    let (heading, speed, bend) = ((a[2] + b[2]) / 2.0, (a[3] + b[3]) / 2.0, (a[4] + b[4]) / 2.0);
    let (sin, cos) = heading.sin_cos();
    let way = speed * dt;
    let mut r = b - a;
    r[0] -= way * cos;
    r[1] -= way * sin;
    r[2] -= way * bend;
    // By the means, half of which each end makes up.
    let mut half = Matrix5::zeros();
    half[(0, 2)] = way * sin / 2.0;
    half[(1, 2)] = -way * cos / 2.0;
    half[(0, 3)] = -dt * cos / 2.0;
    half[(1, 3)] = -dt * sin / 2.0;
    half[(2, 3)] = -dt * bend / 2.0;
    half[(2, 4)] = -way / 2.0;
    (r, half - Matrix5::identity(), half + Matrix5::identity())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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
