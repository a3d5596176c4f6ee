//! The filter that follows a car while frames come in; the result is smoothed anew afterwards (`smooth.rs`).
//!
//! Position and velocity: constant velocity with white acceleration. The heading is kept apart and modulo π, so that a
//! measurement that mistakes front for back neither kills nor turns a track.

use nalgebra::{Matrix2, Matrix2x4, Matrix3, Matrix4, Vector2, Vector3, Vector4};
use roadplane_base::fold_axis;

/// Power of the white acceleration, m²/s³.
const ACCELERATION_POWER: f64 = 4.0;
/// sd of a new car's velocity, m/s.
const FIRST_SPEED_SD: f64 = 8.0;
/// sd of the velocity of a car that was seen not to have moved, m/s.
const HELD_SPEED_SD: f64 = 0.5;
/// Turning of the axis, rad²/s.
const TURN_POWER: f64 = 0.25;
/// Wandering of a parked car, m²/s: settling estimates.
const STILL_POWER: f64 = 4e-4;
/// A car that moved no farther than this …
const STILL_M: f64 = 0.5;
/// … for so long stands still, s.
const STILL_S: f64 = 1.0;
/// A car that was not seen for so long may have come from anywhere, s.
const UNSEEN_S: f64 = 0.6;
/// Largest share that a heading has in a squared distance: a wrong axis is no reason to lose a car.
const MAX_HEADING_TERM: f64 = 6.0;

#[derive(Clone, Debug)]
pub(crate) struct Filter {
    state: Vector4<f64>,
    covariance: Matrix4<f64>,
    axis: f64,
    axis_variance: f64,
    time_s: f64,
    anchor: Vector2<f64>,
    anchor_s: f64,
}

/// Where the car is expected.
#[derive(Clone, Debug)]
struct Prediction {
    state: Vector4<f64>,
    covariance: Matrix4<f64>,
    axis_variance: f64,
}

impl Filter {
    pub(crate) fn new(pose: &Vector3<f64>, covariance: &Matrix3<f64>, time_s: f64) -> Self {
        let mut p = Matrix4::from_diagonal_element(FIRST_SPEED_SD * FIRST_SPEED_SD);
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

    pub(crate) fn position(&self) -> Vector2<f64> {
        self.state.xy()
    }

    /// m/s.
    pub(crate) fn speed(&self) -> f64 {
        self.state[2].hypot(self.state[3])
    }

    pub(crate) fn axis(&self) -> f64 {
        self.axis
    }

    pub(crate) fn axis_sd(&self) -> f64 {
        self.axis_variance.sqrt()
    }

    pub(crate) fn is_still(&self) -> bool {
        self.stood_s() >= STILL_S
    }

    /// How long it has been about where it is, s.
    pub(crate) fn stood_s(&self) -> f64 {
        self.time_s - self.anchor_s
    }

    /// Squared Mahalanobis distance of a measurement, by whichever fits better of standing and driving on. What stood and was
    /// then not seen for a while did not drive on unseen.
    pub(crate) fn distance(&self, pose: &Vector3<f64>, covariance: &Matrix3<f64>, time_s: f64) -> f64 {
        let to = |prediction: &Prediction| {
            let away = pose.xy() - prediction.state.xy();
            let spread = prediction.covariance.fixed_view::<2, 2>(0, 0) + position_part(covariance);
            let position = spread.try_inverse().map_or(f64::INFINITY, |s| away.dot(&(s * away)));
            let turned = fold_axis(pose.z - self.axis);
            let heading = turned * turned / (prediction.axis_variance + covariance[(2, 2)] + 0.01);
            position + heading.min(MAX_HEADING_TERM)
        };
        let driving = || to(&self.driving(time_s));
        match (self.is_still(), time_s - self.time_s > UNSEEN_S) {
            (false, _) => driving(),
            (true, false) => driving().min(to(&self.standing(time_s))),
            (true, true) => to(&self.standing(time_s)),
        }
    }

    /// Takes a measurement. One that lies beyond `gate` (matched by its box) counts less, as its pose must be bad.
    pub(crate) fn update(&mut self, pose: &Vector3<f64>, covariance: &Matrix3<f64>, time_s: f64, gate: f64) {
        let distance = self.distance(pose, covariance, time_s);
        let widened = (distance / gate).clamp(1.0, 1e6);
        let noise = position_part(covariance) * widened;
        let still = self.is_still() && {
            let standing = self.standing(time_s);
            let away = pose.xy() - standing.state.xy();
            let spread = standing.covariance.fixed_view::<2, 2>(0, 0) + noise;
            time_s - self.time_s > UNSEEN_S
                || spread.try_inverse().is_some_and(|s| away.dot(&(s * away)) < gate)
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

    /// The car was seen to be where it was, without a new measurement.
    pub(crate) fn hold(&mut self, time_s: f64) {
        let Prediction { covariance, .. } = self.standing(time_s);
        self.covariance = Matrix4::zeros();
        self.covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&covariance.fixed_view::<2, 2>(0, 0));
        self.covariance.fixed_view_mut::<2, 2>(2, 2).fill_diagonal(HELD_SPEED_SD * HELD_SPEED_SD);
        self.state.fixed_rows_mut::<2>(2).fill(0.0);
        self.time_s = time_s;
    }

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

    fn standing(&self, time_s: f64) -> Prediction {
        let dt = (time_s - self.time_s).max(0.0);
        let mut covariance = self.covariance;
        covariance[(0, 0)] += STILL_POWER * dt;
        covariance[(1, 1)] += STILL_POWER * dt;
        Prediction { state: self.state, covariance, axis_variance: self.axis_variance }
    }
}

fn position_part(covariance: &Matrix3<f64>) -> Matrix2<f64> {
    covariance.fixed_view::<2, 2>(0, 0).into_owned()
}
