//! The filter that follows a car while frames arrive. The final states are smoothed afterwards (`path.rs`).
//!
//! Position and velocity follow a constant-velocity model with white acceleration. The heading is estimated separately,
//! modulo π. A measurement that confuses front and back therefore neither ends nor turns a track.

use nalgebra::{Matrix2, Matrix2x4, Matrix3, Matrix4, Vector2, Vector3, Vector4};
use roadplane_base::fold_axis;
use roadplane_measure::HEADING_SD_RAD;

use crate::box_motion::COAST_S;

/// Power of the white acceleration, m²/s³.
pub(crate) const ACCELERATION_POWER: f64 = 4.0;
/// Sd of each velocity component of a vehicle, m/s.
pub(crate) const SPEED_SD: f64 = 8.0;
/// Sd of each velocity component that a stationary vehicle seems to have, m/s. Below this speed, boxes show no direction
/// of travel, and a vehicle that they place counts as stationary.
pub(crate) const STATIONARY_MPS: f64 = 0.2;
/// Share of vehicles that are stationary when they are first found, 0–1.
pub(crate) const STATIONARY_SHARE: f64 = 0.1;
/// Power of the axis' random turning, rad²/s.
const TURN_POWER: f64 = 0.25;
/// Least sd of a measured position, m: no measurement is better. A parked car wanders by as much in 1 s, while its
/// estimate settles.
pub(crate) const POSE_FLOOR_M: f64 = 0.02;
/// Greatest distance that a stationary car seems to move, and least one that a driving car moves, m. It is also the sd
/// of a creeping car's distance from its line.
pub(crate) const STILL_M: f64 = 0.5;
/// Time scale of motion, s. Motion is measured over this time, and the end of a tracklet is as long. Shorter stops
/// cannot be measured, and a car that stays within [`STILL_M`] for so long counts as stationary.
pub(crate) const MOTION_S: f64 = 1.0;
/// Squared Mahalanobis distance of (x, y, heading) up to which a measurement may belong to a track, without unit.
pub(crate) const GATE: f64 = 20.0;

/// The filter of one car, after its last detection.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Filter {
    /// Position and velocity (x, y, vx, vy) on the ground, m and m/s.
    pub state: Vector4<f64>,
    covariance: Matrix4<f64>,
    /// Heading modulo π, rad.
    pub axis: f64,
    axis_variance: f64,
    time_s: f64,
    /// Position from which the car has not moved noticeably, m.
    anchor: Vector2<f64>,
    /// Time since which the car has been near `anchor`, s.
    anchor_s: f64,
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

    /// Whether the car is stationary.
    pub(crate) fn is_still(&self) -> bool {
        self.time_s - self.anchor_s >= MOTION_S
    }

    /// Returns the squared Mahalanobis distance of a measurement. The car may have stopped or driven on;
    /// the smaller of both distances counts. Without the first case, a car that waited undetected would seem lost.
    pub(crate) fn distance(&self, pose: &Vector3<f64>, covariance: &Matrix3<f64>, time_s: f64) -> f64 {
        let to = |expected: &Self| {
            let turned = fold_axis(pose.z - self.axis);
            let heading =
                turned * turned / (expected.axis_variance + covariance[(2, 2)] + HEADING_SD_RAD.powi(2));
            expected.position_distance(pose, &position_part(covariance)) + heading
        };
        let driving = || to(&self.driving(time_s));
        match (self.is_still(), time_s - self.time_s > COAST_S) {
            (false, _) => driving(),
            (true, false) => driving().min(to(&self.stationary(time_s))),
            (true, true) => to(&self.stationary(time_s)),
        }
    }

    /// Updates the state with a measurement. One that lies beyond [`GATE`] was matched by its box and counts less, as
    /// its pose must be bad.
    pub(crate) fn update(&mut self, pose: &Vector3<f64>, covariance: &Matrix3<f64>, time_s: f64) {
        let distance = self.distance(pose, covariance, time_s);
        let widened = (distance / GATE).clamp(1.0, 1e6);
        let noise = position_part(covariance) * widened;
        let stationary = self.stationary(time_s);
        let still = self.is_still()
            && (time_s - self.time_s > COAST_S || stationary.position_distance(pose, &noise) < GATE);
        let expected = if still { stationary } else { self.driving(time_s) };
        let (h, p) = (Matrix2x4::<f64>::identity(), expected.covariance);
        if let Some(inverse) = (h * p * h.transpose() + noise).try_inverse() {
            let gain = p * h.transpose() * inverse;
            self.state = expected.state + gain * (pose.xy() - expected.state.xy());
            let rest = Matrix4::identity() - gain * h;
            self.covariance = rest * p * rest.transpose() + gain * noise * gain.transpose();
        }
        let axis_variance = expected.axis_variance;
        let share = axis_variance / (axis_variance + covariance[(2, 2)] * widened + HEADING_SD_RAD.powi(2));
        self.axis += share * fold_axis(pose.z - self.axis);
        self.axis_variance = (1.0 - share) * axis_variance;
        self.time_s = time_s;
        let sd = self.covariance.fixed_view::<2, 2>(0, 0).trace().max(0.0).sqrt();
        if (self.state.xy() - self.anchor).norm() > STILL_M + 2.0 * sd {
            self.anchor = self.state.xy();
            self.anchor_s = time_s;
        }
    }

    /// Updates the state with a car that is carried over: its position is unchanged and not measured again.
    pub(crate) fn carry_over(&mut self, time_s: f64) {
        let covariance = self.stationary(time_s).covariance;
        self.covariance = Matrix4::zeros();
        self.covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&covariance.fixed_view::<2, 2>(0, 0));
        self.covariance.fixed_view_mut::<2, 2>(2, 2).fill_diagonal(STATIONARY_MPS * STATIONARY_MPS);
        self.state.fixed_rows_mut::<2>(2).fill(0.0);
        self.time_s = time_s;
    }

    /// Returns the squared Mahalanobis distance of a measured position with this covariance.
    fn position_distance(&self, pose: &Vector3<f64>, covariance: &Matrix2<f64>) -> f64 {
        let away = pose.xy() - self.state.xy();
        let spread = self.covariance.fixed_view::<2, 2>(0, 0) + covariance;
        spread.try_inverse().map_or(f64::INFINITY, |s| away.dot(&(s * away)))
    }

    /// Predicts the state of a car that drives on.
    fn driving(&self, time_s: f64) -> Self {
        let dt = (time_s - self.time_s).max(0.0);
        let (state, covariance) = driven(&self.state, &self.covariance, dt);
        Self { state, covariance, axis_variance: self.axis_variance + TURN_POWER * dt, ..*self }
    }

    /// Predicts the state of a car that is stationary.
    fn stationary(&self, time_s: f64) -> Self {
        let dt = (time_s - self.time_s).max(0.0);
        let mut covariance = self.covariance;
        covariance[(0, 0)] += POSE_FLOOR_M * POSE_FLOOR_M * dt;
        covariance[(1, 1)] += POSE_FLOOR_M * POSE_FLOOR_M * dt;
        Self { covariance, ..*self }
    }
}

/// Returns position and velocity (m, m/s) after `dt` seconds with white acceleration, and their covariance.
pub(crate) fn driven(
    state: &Vector4<f64>,
    covariance: &Matrix4<f64>,
    dt: f64,
) -> (Vector4<f64>, Matrix4<f64>) {
    let each_axis = |of_one: Matrix2<f64>| of_one.kronecker(&Matrix2::identity());
    let f = each_axis(Matrix2::new(1.0, dt, 0.0, 1.0));
    let q = each_axis(Matrix2::new(dt.powi(3) / 3.0, dt * dt / 2.0, dt * dt / 2.0, dt));
    (f * state, f * covariance * f.transpose() + q * ACCELERATION_POWER)
}

/// Returns the density of a velocity or speed among all vehicles, from its densities among stationary and driving ones.
pub(crate) fn mixed(stationary: f64, driving: f64) -> f64 {
    STATIONARY_SHARE * stationary + (1.0 - STATIONARY_SHARE) * driving
}

/// Returns the covariance of (x, y) from that of (x, y, heading), m².
fn position_part(covariance: &Matrix3<f64>) -> Matrix2<f64> {
    covariance.fixed_view::<2, 2>(0, 0).into_owned()
}
