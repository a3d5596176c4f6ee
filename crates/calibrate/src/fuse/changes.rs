//! Finds changes of the camera that only the windows' estimates show: sudden moves and drift.

use nalgebra::{Matrix4, Vector4};

use super::FuseOptions;
use super::group::{SCATTER, constant, middle_s, shares};
use crate::WindowEstimate;

/// Least gain in log likelihood for which a change or a drift of the camera is accepted.
const MIN_GAIN: f64 = 16.0;
/// Multiples of [`DRIFT_SD`] that are tried.
const DRIFTS: [f64; 4] = [1.0, 4.0, 16.0, 64.0];

/// Drift of a mounted camera: sds of log focal length, tilt, roll and log height after 1 s. They grow with the root of
/// time.
pub(super) const DRIFT_SD: Vector4<f64> = Vector4::new(1e-4, 5e-5, 5e-5, 1e-4);

/// A group of windows in which the camera was either stationary or drifting.
pub(super) struct Part<'a, 'w> {
    /// The windows, in the order of time.
    pub windows: &'a [&'w WindowEstimate],
    /// Drift as a multiple of [`DRIFT_SD`]; `None` for a stationary camera.
    pub drift: Option<f64>,
}

/// Finds the best explanation of a group: a stationary camera, a drift, or a sudden change with an explanation of each
/// side.
///
/// Returns the parts and their gain in log likelihood. Each change or drift must gain at least [`MIN_GAIN`]. No change
/// is accepted where parked cars confirm a stationary camera. One window alone is no change: the next one must agree.
pub(super) fn explain<'a, 'w>(
    group: &'a [&'w WindowEstimate],
    options: &FuseOptions,
) -> (Vec<Part<'a, 'w>>, f64) {
    let standing = (vec![Part { windows: group, drift: None }], 0.0);
    if group.len() < 4 || group[1..].iter().all(|window| window.steady) {
        return standing;
    }
    let cost = |part: &[&WindowEstimate]| constant(part, &shares(part), options).cost;
    let whole = cost(group);
    let gains = (2..=group.len() - 2)
        .filter(|&cut| !group[cut].steady)
        .map(|cut| (cut, whole - cost(&group[..cut]) - cost(&group[cut..]) - MIN_GAIN));
    let best = gains.reduce(|best, next| if next.1 > best.1 { next } else { best });
    let changed = best.filter(|(_, gain)| *gain > 0.0).map_or(standing, |(cut, gain)| {
        let (mut parts, before) = explain(&group[..cut], options);
        let (rest, after) = explain(&group[cut..], options);
        parts.extend(rest);
        (parts, gain + before + after)
    });
    let (scale, gain) = drift_of(group, options);
    let drifted = gain - MIN_GAIN;
    if drifted > changed.1 { (vec![Part { windows: group, drift: Some(scale) }], drifted) } else { changed }
}

/// Returns the multiple of [`DRIFT_SD`] that explains a group best, and its gain in log likelihood over no drift.
fn drift_of(group: &[&WindowEstimate], options: &FuseOptions) -> (f64, f64) {
    let still = drift_log_likelihood(group, 0.0, options);
    let gains = DRIFTS.map(|scale| (scale, drift_log_likelihood(group, scale, options) - still));
    gains.into_iter().fold((0.0, 0.0), |best, next| if next.1 > best.1 { next } else { best })
}

/// Returns the log likelihood of the windows' innovations in a random walk with Student-t tails.
///
/// `scale` is the drift as a multiple of [`DRIFT_SD`].
fn drift_log_likelihood(group: &[&WindowEstimate], scale: f64, options: &FuseOptions) -> f64 {
    let mut mean = options.prior.params.to_vector();
    let mut covariance = Matrix4::from_diagonal(&options.prior.sd.map(|sd| sd * sd));
    let loose = covariance.map(|v| 1e4 * v);
    let mut total = 0.0;
    for (i, window) in group.iter().enumerate() {
        if i > 0 {
            let gap_s = (middle_s(&group[i..=i]) - middle_s(&group[i - 1..i])).max(0.0);
            covariance += Matrix4::from_diagonal(&(DRIFT_SD * scale).map(|sd| sd * sd * gap_s));
        }
        // Numbers without evidence in the window get a large, but finite, variance.
        let weak = Matrix4::from_diagonal(&loose.diagonal().map(|v| 1.0 / v));
        let Some(noise) = (window.joint.information + weak).try_inverse() else { continue };
        let innovation = window.params.to_vector() - mean;
        let Some(factor) = (covariance + noise).cholesky() else { continue };
        let d2 = innovation.dot(&factor.solve(&innovation));
        total -= SCATTER.cost(d2) + 0.5 * factor.determinant().ln();
        let Some(factor) = (covariance + noise / SCATTER.weight(d2)).cholesky() else { continue };
        let gain = factor.solve(&covariance).transpose();
        mean += gain * innovation;
        covariance -= gain * covariance;
        covariance = (covariance + covariance.transpose()) / 2.0;
    }
    total
}
