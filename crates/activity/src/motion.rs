//! The samples of a track, and a smooth motion that is fitted to them at regular time steps.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use thiserror::Error;

/// Time between two steps, s. The times of all steps are multiples of this value.
pub const STEP_S: f64 = 0.2;
/// Sd of the Gaussian that weights samples by their time from the step, s.
const WINDOW_SD_S: f64 = 0.35;
/// Half width of the time window around a step, s. Samples outside the window have no weight.
const WINDOW_S: f64 = 1.05;
/// Sum of the weights in a window, as a number of samples. The sum is the same at any frame rate.
const WEIGHT: f64 = 5.0;
/// Sd of the prior on speed, m/s.
const SPEED_MPS: f64 = 10.0;
/// Sd of the prior on acceleration, m/s².
const ACCELERATION: f64 = 2.5;
/// Sd of a measured heading, rad.
const HEADING_SD: f64 = 0.05;
/// Sd of the prior on the rate of the heading, rad/s.
const YAW_RATE: f64 = 1.0;
/// Smallest sd of a position, m.
const LEAST_SD_M: f64 = 0.05;
/// Sd of a position that is given without its sd, m.
const UNKNOWN_SD_M: f64 = 0.15;

/// The samples of one track, sorted by time. Each list has one value per sample. Optional lists may be empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    /// Times of the samples in rising order, s. Equal times are allowed.
    pub time_s: Vec<f64>,
    /// Positions on the ground, m, in a right-handed frame with z up.
    pub xy_m: Vec<[f64; 2]>,
    /// Headings, rad: 0 along +x, counter-clockwise. The list may be empty.
    pub heading_rad: Vec<f64>,
    /// Sds of the positions in x and y, m. The list may be empty.
    pub sd_m: Vec<[f64; 2]>,
    /// Whether each sample was observed. Other samples are interpolated. If the list is empty, all samples were
    /// observed.
    pub seen: Vec<bool>,
}

/// The reason why a motion is not valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum MotionError {
    /// The motion has no samples.
    #[error("a track has no samples")]
    Empty,
    /// The lists of the motion differ in length.
    #[error(
        "a track needs one position per time, and as many headings, standard deviations and observations if given"
    )]
    Lengths,
    /// The motion has a number that is not finite, or a negative sd.
    #[error("a track has a number that is not finite, or a negative standard deviation")]
    NotFinite,
    /// A time of the motion is earlier than the time before it.
    #[error("a track's times are not in order")]
    Order,
    /// The motion lasts longer than seven days.
    #[error("a track spans more than {} hours", MAX_SPAN_S / 3600.0)]
    TooLong,
}

/// Longest duration of a track, s.
const MAX_SPAN_S: f64 = 7.0 * 24.0 * 3600.0;

impl Motion {
    /// Checks that the motion is a valid input for the net.
    ///
    /// # Errors
    /// The first [`MotionError`] that applies.
    pub fn check(&self) -> Result<(), MotionError> {
        let (Some(first), Some(last)) = (self.time_s.first(), self.time_s.last()) else {
            return Err(MotionError::Empty);
        };
        let n = self.time_s.len();
        let fits = |len: usize| len == 0 || len == n;
        if self.xy_m.len() != n
            || !fits(self.heading_rad.len())
            || !fits(self.sd_m.len())
            || !fits(self.seen.len())
        {
            return Err(MotionError::Lengths);
        }
        let plain = self.time_s.iter().chain(self.xy_m.iter().flatten()).chain(&self.heading_rad);
        if !plain.copied().all(f64::is_finite)
            || !self.sd_m.iter().flatten().all(|sd| *sd >= 0.0 && sd.is_finite())
        {
            return Err(MotionError::NotFinite);
        }
        if self.time_s.windows(2).any(|pair| pair[1] < pair[0]) {
            return Err(MotionError::Order);
        }
        if last - first > MAX_SPAN_S { Err(MotionError::TooLong) } else { Ok(()) }
    }
}

/// Returns the steps that cover a time from `first_s` to `last_s` (s), as multiples of [`STEP_S`]. The first step is
/// not later than `first_s`, and the last step is not earlier than `last_s`.
#[must_use]
pub fn grid(first_s: f64, last_s: f64) -> std::ops::RangeInclusive<i64> {
    (first_s / STEP_S + 1e-6).floor() as i64..=(last_s / STEP_S - 1e-6).ceil() as i64
}

/// The smooth motion around one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Local {
    /// Velocity, m/s.
    pub velocity: Vector2<f64>,
    /// Acceleration, m/s².
    pub acceleration: Vector2<f64>,
    /// Root mean square distance between the positions and the fitted motion, m.
    pub rms_m: f64,
    /// Sds of the positions in x and y, m.
    pub sd_m: Vector2<f64>,
    /// Heading (rad) and its rate (rad/s), if the motion has headings.
    pub heading: Option<[f64; 2]>,
    /// Time to the nearest observed sample, s.
    pub gap_s: f64,
}

/// Returns the times of the observed samples, s.
pub(crate) fn seen_times(motion: &Motion) -> Vec<f64> {
    let seen = |i: usize| motion.seen.get(i).copied().unwrap_or(true);
    motion.time_s.iter().enumerate().filter(|(i, _)| seen(*i)).map(|(_, t)| *t).collect()
}

/// Returns the time between `at_s` and the nearest of `times` (in rising order), s. Returns infinity if `times` is
/// empty.
fn nearest(times: &[f64], at_s: f64) -> f64 {
    let after = times.partition_point(|t| *t < at_s);
    let beside = after.saturating_sub(1)..(after + 1).min(times.len());
    times[beside].iter().map(|t| (t - at_s).abs()).fold(f64::INFINITY, f64::min)
}

/// Returns the headings (rad). Each heading is changed by whole turns to be nearest to the heading before it.
pub(crate) fn unwrapped(headings: &[f64]) -> Vec<f64> {
    let mut last: Option<f64> = None;
    let step = |heading: &f64| {
        let near =
            last.map_or(*heading, |before| before + roadplane_base::angle_difference(*heading, before));
        last = Some(near);
        near
    };
    headings.iter().map(step).collect()
}

/// Fits a parabola to the positions around a time. The axes x and y have separate fits.
///
/// The fit is by least squares with Gaussian weights in time. It has priors on speed and acceleration, which are
/// weighted by the variance of the positions. `headings` is the result of [`unwrapped`], and `seen_s` is the result of
/// [`seen_times`].
pub(crate) fn local(motion: &Motion, headings: &[f64], seen_s: &[f64], at_s: f64) -> Local {
    let times = &motion.time_s;
    let near_s = nearest(times, at_s);
    // In a gap, the window extends to the nearest sample. Otherwise it would be empty.
    let reach = near_s + WINDOW_S;
    let window = times.partition_point(|t| *t < at_s - reach)..times.partition_point(|t| *t <= at_s + reach);
    let mut weights: Vec<f64> = times[window.clone()]
        .iter()
        .map(|t| (-0.5 * (((t - at_s).abs() - near_s).max(0.0) / WINDOW_SD_S).powi(2)).exp())
        .collect();
    let total: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight *= WEIGHT / total);
    let samples = || window.clone().zip(&weights).map(|(i, weight)| (i, *weight, times[i] - at_s));

    let mut normal = Matrix3::zeros();
    for (_, weight, dt) in samples() {
        let basis = Vector3::new(1.0, dt, dt * dt / 2.0);
        normal += weight * basis * basis.transpose();
    }
    let sd_of =
        |i: usize, axis: usize| motion.sd_m.get(i).map_or(UNKNOWN_SD_M, |sd| sd[axis].max(LEAST_SD_M));
    let axis = |axis: usize| {
        let (mut right, mut variance) = (Vector3::zeros(), 0.0);
        for (i, weight, dt) in samples() {
            right += weight * motion.xy_m[i][axis] * Vector3::new(1.0, dt, dt * dt / 2.0);
            variance += weight * sd_of(i, axis).powi(2) / WEIGHT;
        }
        let priors = Vector3::new(0.0, SPEED_MPS.powi(-2), ACCELERATION.powi(-2)) * variance;
        // The matrix is positive definite, because the weights and the priors are positive.
        let fit = (normal + Matrix3::from_diagonal(&priors))
            .cholesky()
            .map_or(Vector3::zeros(), |c| c.solve(&right));
        let square: f64 = samples()
            .map(|(i, weight, dt)| {
                weight * (motion.xy_m[i][axis] - fit.x - fit.y * dt - fit.z * dt * dt / 2.0).powi(2)
            })
            .sum();
        (fit, variance.sqrt(), square / WEIGHT)
    };
    let (x, y) = (axis(0), axis(1));
    let heading = (!headings.is_empty()).then(|| {
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for (i, weight, dt) in samples() {
            let basis = Vector2::new(1.0, dt);
            normal += weight * basis * basis.transpose();
            right += weight * headings[i] * basis;
        }
        normal[(1, 1)] += (HEADING_SD / YAW_RATE).powi(2);
        let fit = normal.cholesky().map_or(Vector2::zeros(), |c| c.solve(&right));
        [fit.x, fit.y]
    });
    Local {
        velocity: Vector2::new(x.0.y, y.0.y),
        acceleration: Vector2::new(x.0.z, y.0.z),
        rms_m: (x.2 + y.2).sqrt(),
        sd_m: Vector2::new(x.1, y.1),
        heading,
        gap_s: nearest(seen_s, at_s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the motion of a car along +x. It drives at 3 m/s at a time of 1 s, and brakes by 0.5 m/s². There are
    /// `hz` samples per second.
    fn braking(hz: f64) -> Motion {
        let time_s: Vec<f64> = (0..(4.0 * hz) as usize).map(|i| 1.0 + i as f64 / hz).collect();
        let xy_m = time_s.iter().map(|t| [3.0 * (t - 1.0) - 0.25 * (t - 1.0).powi(2), 7.0]).collect();
        Motion { heading_rad: vec![0.1; time_s.len()], time_s, xy_m, ..Motion::default() }
    }

    #[test]
    fn a_parabola_is_found_at_any_frame_rate() {
        for hz in [5.0, 10.0, 29.97, 60.0] {
            let motion = braking(hz);
            let local = local(&motion, &motion.heading_rad, &motion.time_s, 3.0);
            // The prior reduces the acceleration by the same share at every frame rate.
            assert!((local.velocity.x - 2.0).abs() < 0.02, "{hz} {:?}", local.velocity);
            assert!(local.acceleration.x < -0.3 && local.velocity.y.abs() < 1e-9, "{hz}");
            let [heading, rate] = local.heading.unwrap();
            assert!((heading - 0.1).abs() < 1e-9 && rate.abs() < 1e-9);
        }
    }

    #[test]
    fn lone_samples_and_gaps_have_no_speed() {
        let one = Motion { time_s: vec![2.0], xy_m: vec![[1.0, 2.0]], ..Motion::default() };
        let here = local(&one, &[], &[2.0], 2.0);
        assert!(here.velocity.norm() < 1e-9 && here.gap_s == 0.0);
        assert!((local(&one, &[], &[2.0], 4.0).gap_s - 2.0).abs() < 1e-12);
        let two =
            Motion { time_s: vec![0.0, 20.0], xy_m: vec![[0.0, 0.0], [100.0, 0.0]], ..Motion::default() };
        assert!(local(&two, &[], &[], 4.0).velocity.norm() < 1.0);
    }

    #[test]
    fn invalid_motions_are_refused() {
        let good = braking(5.0);
        assert_eq!(good.check(), Ok(()));
        assert_eq!(Motion::default().check(), Err(MotionError::Empty));
        let mut bad = good.clone();
        bad.xy_m[3][0] = f64::NAN;
        assert_eq!(bad.check(), Err(MotionError::NotFinite));
        let mut bad = good.clone();
        bad.time_s.swap(1, 2);
        assert_eq!(bad.check(), Err(MotionError::Order));
        let mut bad = good;
        bad.heading_rad.pop();
        assert_eq!(bad.check(), Err(MotionError::Lengths));
    }
}
