//! Features of a motion: the input of the net, with one row per time step.
//!
//! The script `scripts/train/activity/features.py` computes the same features. The file
//! `tests/data/activity/features.json` tests both programs.

use crate::motion::{Local, Motion, STEP_S, local, seen_times, unwrapped};

/// Number of features per step.
pub const FEATURES: usize = 15;
/// Index of the time to the nearest observed sample (s, at most 2), which is the last feature.
pub(crate) const GAP: usize = FEATURES - 1;
/// Unit of the first feature, m/s. The feature is the speed in this unit.
const SPEED_MPS: f64 = 5.0;
/// Speed below which the features of the direction of motion approach 0, m/s.
const SLOW_MPS: f64 = 0.3;

/// Returns the features of a motion, one row per step. `steps` are multiples of [`crate::STEP_S`]. The motion must have
/// passed [`Motion::check`].
#[must_use]
pub fn features(motion: &Motion, steps: &[i64]) -> Vec<[f32; FEATURES]> {
    let (headings, seen_s) = (unwrapped(&motion.heading_rad), seen_times(motion));
    steps.iter().map(|step| row(&local(motion, &headings, &seen_s, *step as f64 * STEP_S))).collect()
}

/// Returns the speed that a row of features contains, m/s.
pub(crate) fn speed_mps(row: &[f32; FEATURES]) -> f64 {
    f64::from(row[0]) * SPEED_MPS
}

fn row(local: &Local) -> [f32; FEATURES] {
    let (v, a) = (local.velocity, local.acceleration);
    let speed = v.norm();
    let faded = speed.hypot(SLOW_MPS);
    let along = v.dot(&a) / faded;
    let across = v.perp(&a) / faded;
    let course_rate = across / faded;
    let (has_heading, forward, sideways, yaw_rate) = match local.heading {
        None => (0.0, speed, 0.0, course_rate),
        Some([heading, rate]) => {
            let (sin, cos) = heading.sin_cos();
            (1.0, v.x * cos + v.y * sin, v.y * cos - v.x * sin, rate)
        }
    };
    // Next: the variances along the motion and across it. For a stationary car, both are the mean of the variances of
    // the two axes.
    let stationary = (SLOW_MPS / faded).powi(2) / 2.0;
    let [x, y] = [v.x, v.y].map(|part| (part / faded).powi(2) + stationary);
    let [sx, sy] = [local.sd_m.x.powi(2), local.sd_m.y.powi(2)];
    let sd = |square: f64| (square.sqrt().clamp(0.05, 2.0) / 0.2).ln();
    [
        speed / SPEED_MPS,
        (speed / SLOW_MPS).ln_1p() / 3.0,
        forward.tanh(),
        sideways.clamp(-2.0, 2.0),
        along / 2.0,
        across / 2.0,
        course_rate.clamp(-2.0, 2.0),
        (across / faded.powi(2)).clamp(-1.0, 1.0) * 3.0,
        yaw_rate.clamp(-2.0, 2.0),
        has_heading,
        has_heading * (forward / SLOW_MPS).tanh(),
        (local.rms_m.clamp(0.005, 1.0) / 0.05).ln() / 2.0,
        sd(x * sx + y * sy),
        sd(y * sx + x * sy),
        local.gap_s.min(2.0),
    ]
    .map(|value| value as f32)
}
