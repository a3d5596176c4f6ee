//! The filter that follows a car while frames arrive. The final states are smoothed afterwards (`smooth.rs`).
//!
//! Position and velocity follow a constant-velocity model with white acceleration. The heading is estimated separately,
//! modulo π. A measurement that confuses front and back therefore neither ends nor turns a track.

use nalgebra::{Matrix2, Matrix2x4, Matrix3, Matrix4, Vector2, Vector3, Vector4};
use roadplane_base::fold_axis;

use crate::box_motion::COAST_S;

/// Power of the white acceleration, m²/s³.
pub(crate) const ACCELERATION_POWER: f64 = 4.0;
/// Sd of each velocity component of a vehicle, m/s.
pub(crate) const SPEED_SD: f64 = 8.0;
/// Sd of each velocity component that a stationary vehicle seems to have, m/s. Below this speed, boxes show no direction
/// of travel, and a vehicle that they place counts as stationary.
pub(crate) const STANDING_MPS: f64 = 0.2;
/// Power of the axis' random turning, rad²/s.
const TURN_POWER: f64 = 0.25;
/// Power of the wandering of a parked car, m²/s. It allows for estimates that still settle.
const STILL_POWER: f64 = 4e-4;
/// Greatest distance that a stationary car seems to move, and least one that a driving car moves, m. It is also the sd
/// of a creeping car's distance from its line.
pub(crate) const STILL_M: f64 = 0.5;
/// Time scale of motion, s. Motion is measured over this time, and the end of a tracklet is as long. Shorter stops
/// cannot be measured, and a car that stays within [`STILL_M`] for so long counts as stationary.
pub(crate) const MOTION_S: f64 = 1.0;
/// Squared Mahalanobis distance of (x, y, heading) up to which a measurement may belong to a track, without unit.
pub(crate) const GATE: f64 = 20.0;

/// The filter of one car, after its last detection.
#[derive(Clone, Debug)]
pub(crate) struct Filter {
    /// Position and velocity (x, y, vx, vy) on the ground, m and m/s.
    state: Vector4<f64>,
    /// Covariance of `state`, m and m/s.
    covariance: Matrix4<f64>,
    /// Heading modulo π, rad.
    axis: f64,
    /// Variance of the axis, rad².
    axis_variance: f64,
    /// Time of the last update, s.
    time_s: f64,
    /// Position from which the car has not moved noticeably, m.
    anchor: Vector2<f64>,
    /// Time since which the car has been near `anchor`, s.
    anchor_s: f64,
}

/// The state that is expected at a later time.
#[derive(Clone, Debug)]
struct Prediction {
    /// Expected position and velocity (x, y, vx, vy), m and m/s.
    state: Vector4<f64>,
    /// Covariance of `state`, m and m/s.
    covariance: Matrix4<f64>,
    /// Variance of the expected axis, rad².
    axis_variance: f64,
}

impl Filter {
    /// Starts with the first measurement of a car: its pose (x, y, heading) with covariance, and its time in s.
    pub(crate) fn new(pose: &Vector3<f64>, covariance: &Matrix3<f64>, time_s: f64) -> Self {
        let mut p = Matrix4::from_diagonal_element(SPEED_SD * SPEED_SD);
        p.fixed_view_mut::<2, 2>(0, 0).copy_from(&position_part(covariance));
        p.fixed_view_mut::<2, 2>(0, 2).fill(0.0);
        p.fixed_view_mut::<2, 2>(2, 0).fill(0.0);
        Self {
            state: Vector4::new(pose.x, pose.y, 0.0, 0.0),
            covariance: p,
            axis: pose.z,
            axis_variance: covariance[(2, 2)],
            time_s,
            anchor: pose.xy(),
            anchor_s: time_s,
        }
    }

    /// Returns the estimated position (x, y), m.
    pub(crate) fn position(&self) -> Vector2<f64> {
        self.state.xy()
    }

    /// Returns the estimated heading modulo π, rad.
    pub(crate) fn axis(&self) -> f64 {
        self.axis
    }

    /// Whether the car is stationary.
    pub(crate) fn is_still(&self) -> bool {
        self.time_s - self.anchor_s >= MOTION_S
    }

    /// Returns the squared Mahalanobis distance of a measurement. The car may have stopped or driven on;
    /// the smaller of both distances counts. Without the first case, a car that waited undetected would seem lost.
    pub(crate) fn distance(&self, pose: &Vector3<f64>, covariance: &Matrix3<f64>, time_s: f64) -> f64 {
        let to = |prediction: &Prediction| {
            let away = pose.xy() - prediction.state.xy();
            let spread = prediction.covariance.fixed_view::<2, 2>(0, 0) + position_part(covariance);
            let position = spread.try_inverse().map_or(f64::INFINITY, |s| away.dot(&(s * away)));
            let turned = fold_axis(pose.z - self.axis);
            let heading = turned * turned / (prediction.axis_variance + covariance[(2, 2)] + 0.01);
            position + heading
        };
        let driving = || to(&self.driving(time_s));
        match (self.is_still(), time_s - self.time_s > COAST_S) {
            (false, _) => driving(),
            (true, false) => driving().min(to(&self.standing(time_s))),
            (true, true) => to(&self.standing(time_s)),
        }
    }

    /// Updates the state with a measurement. One that lies beyond [`GATE`] was matched by its box and counts less, as
    /// its pose must be bad.
    pub(crate) fn update(&mut self, pose: &Vector3<f64>, covariance: &Matrix3<f64>, time_s: f64) {
        let distance = self.distance(pose, covariance, time_s);
        let widened = (distance / GATE).clamp(1.0, 1e6);
        let noise = position_part(covariance) * widened;
        let still = self.is_still() && {
            let standing = self.standing(time_s);
            let away = pose.xy() - standing.state.xy();
            let spread = standing.covariance.fixed_view::<2, 2>(0, 0) + noise;
            time_s - self.time_s > COAST_S
                || spread.try_inverse().is_some_and(|s| away.dot(&(s * away)) < GATE)
        };
        let Prediction { state, covariance: p, axis_variance } =
            if still { self.standing(time_s) } else { self.driving(time_s) };
        let h = Matrix2x4::<f64>::identity();
        let spread: Matrix2<f64> = h * p * h.transpose() + noise;
        if let Some(inverse) = spread.try_inverse() {
            let gain = p * h.transpose() * inverse;
            self.state = state + gain * (pose.xy() - state.xy());
            let rest = Matrix4::identity() - gain * h;
            self.covariance = rest * p * rest.transpose() + gain * noise * gain.transpose();
        }
        let share = axis_variance / (axis_variance + covariance[(2, 2)] * widened + 0.01);
        self.axis += share * fold_axis(pose.z - self.axis);
        self.axis_variance = (1.0 - share) * axis_variance;
        self.time_s = time_s;
        let sd = self.covariance.fixed_view::<2, 2>(0, 0).trace().max(0.0).sqrt();
        if (self.position() - self.anchor).norm() > STILL_M + 2.0 * sd {
            self.anchor = self.position();
            self.anchor_s = time_s;
        }
    }

    /// Updates the state with a car that is carried over: its position is unchanged and not measured again.
    pub(crate) fn hold(&mut self, time_s: f64) {
        let Prediction { covariance, .. } = self.standing(time_s);
        self.covariance = Matrix4::zeros();
        self.covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&covariance.fixed_view::<2, 2>(0, 0));
        self.covariance.fixed_view_mut::<2, 2>(2, 2).fill_diagonal(STANDING_MPS * STANDING_MPS);
        self.state.fixed_rows_mut::<2>(2).fill(0.0);
        self.time_s = time_s;
    }

    /// Predicts the state of a car that drives on.
    fn driving(&self, time_s: f64) -> Prediction {
        let dt = (time_s - self.time_s).max(0.0);
        let eye = Matrix2::identity();
        let mut f = Matrix4::identity();
        f.fixed_view_mut::<2, 2>(0, 2).copy_from(&(eye * dt));
        let mut q = Matrix4::zeros();
        q.fixed_view_mut::<2, 2>(0, 0).copy_from(&(eye * (ACCELERATION_POWER * dt.powi(3) / 3.0)));
        q.fixed_view_mut::<2, 2>(0, 2).copy_from(&(eye * (ACCELERATION_POWER * dt * dt / 2.0)));
        q.fixed_view_mut::<2, 2>(2, 0).copy_from(&(eye * (ACCELERATION_POWER * dt * dt / 2.0)));
        q.fixed_view_mut::<2, 2>(2, 2).copy_from(&(eye * (ACCELERATION_POWER * dt)));
        Prediction {
            state: f * self.state,
            covariance: f * self.covariance * f.transpose() + q,
            axis_variance: self.axis_variance + TURN_POWER * dt,
        }
    }

    /// Predicts the state of a car that is stationary.
    fn standing(&self, time_s: f64) -> Prediction {
        let dt = (time_s - self.time_s).max(0.0);
        let mut covariance = self.covariance;
        covariance[(0, 0)] += STILL_POWER * dt;
        covariance[(1, 1)] += STILL_POWER * dt;
        Prediction { state: self.state, covariance, axis_variance: self.axis_variance }
    }
}

/// Returns the covariance of (x, y) from that of (x, y, heading), m².
fn position_part(covariance: &Matrix3<f64>) -> Matrix2<f64> {
    covariance.fixed_view::<2, 2>(0, 0).into_owned()
}
