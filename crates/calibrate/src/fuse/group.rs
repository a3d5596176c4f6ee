//! The evidence of windows that have one constant camera.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, JointInformation, StudentT, weighted_median};

use super::FuseOptions;
use super::horizon::{Seen, by_camera, information_with_tilt, with_horizon, with_tilt};
use crate::{CarIdentity, CarUse, WindowEstimate};

/// Error model of windows; a window with a wrong minimum has little weight.
pub(super) const SCATTER: StudentT = StudentT { dimensions: 4.0 };

/// Returns the mean and the information of the camera's prior on (log f, horizon, roll, log h').
fn prior(options: &FuseOptions) -> (Vector4<f64>, Matrix4<f64>) {
    let camera = options.prior.params.to_vector();
    let back = by_camera(&camera).try_inverse().unwrap_or_else(Matrix4::identity);
    let information = Matrix4::from_diagonal(&options.prior.sd.map(|sd| 1.0 / (sd * sd)));
    (with_horizon(&camera), back.transpose() * information * back)
}

/// Returns the share of each window's evidence that other windows of the group do not already contain, 0–1.
pub(super) fn shares(group: &[Seen<'_>], options: &FuseOptions) -> Vec<f64> {
    let mut windows_of: BTreeMap<CarIdentity, f64> = BTreeMap::new();
    for seen in group {
        for car in seen.window.cars.iter().map(|used| used.car).collect::<BTreeSet<_>>() {
            *windows_of.entry(car).or_default() += 1.0;
        }
    }
    let share = |Seen { window, .. }: &Seen<'_>| {
        let of_car = |used: &CarUse| {
            let correlation =
                if used.parked { options.parked_correlation } else { options.moving_correlation };
            1.0 / (1.0 + (windows_of.get(&used.car).copied().unwrap_or(1.0) - 1.0) * correlation)
        };
        let total: f64 = window.cars.iter().map(of_car).sum();
        if window.cars.is_empty() { 1.0 / group.len() as f64 } else { total / window.cars.len() as f64 }
    };
    group.iter().map(share).collect()
}

/// A robust fit of one constant camera to a group of windows.
pub(super) struct Constant {
    /// Student-t weight of each window.
    weights: Vec<f64>,
    /// Squared Mahalanobis distance of each window from the constant.
    distances: Vec<f64>,
    /// Cost `Σ (ν + 4) ln(1 + d²/ν) / 2` over the windows.
    pub cost: f64,
}

/// Fits one constant camera to a group. `shares` are the windows' shares of new evidence, 0–1.
pub(super) fn constant(group: &[Seen<'_>], shares: &[f64], options: &FuseOptions) -> Constant {
    let (prior, prior_information) = prior(options);
    let mut centre = Vector4::from_fn(|i, _| {
        let mut values: Vec<(f64, f64)> = group
            .iter()
            .zip(shares)
            .map(|(seen, share)| (seen.mean[i], share * seen.joint.information[(i, i)]))
            .collect();
        weighted_median(&mut values).unwrap_or(prior[i])
    });
    let distance = |seen: &Seen<'_>, centre: &Vector4<f64>| {
        let away = seen.mean - centre;
        away.dot(&(seen.joint.information * away)).max(0.0)
    };
    let mut distances = Vec::new();
    let mut weights = Vec::new();
    for _ in 0..30 {
        distances = group.iter().map(|seen| distance(seen, &centre)).collect();
        weights = distances.iter().map(|d2| SCATTER.weight(*d2)).collect();
        let mut information = prior_information;
        let mut sum = prior_information * prior;
        for ((seen, share), weight) in group.iter().zip(shares).zip(&weights) {
            let own = seen.joint.information * (share * weight);
            information += own;
            sum += own * seen.mean;
        }
        let Some(next) = information.cholesky().map(|c| c.solve(&sum)) else { break };
        let moved = (next - centre).norm();
        centre = next;
        if moved < 1e-12 {
            break;
        }
    }
    let cost = distances.iter().map(|d2| SCATTER.cost(*d2)).sum();
    Constant { weights, distances, cost }
}

/// Returns the joint evidence of a group under one constant camera.
///
/// If windows scatter more than their covariances allow, the covariance is widened (Birge's ratio).
///
/// `shares` are the windows' shares of new evidence, 0–1.
pub(super) fn together(group: &[Seen<'_>], shares: &[f64], options: &FuseOptions) -> JointInformation {
    let Constant { weights, distances, .. } = constant(group, shares, options);
    let surplus = 4.0 * (group.len() as f64 - 1.0);
    let scatter: f64 = distances.iter().zip(&weights).map(|(d2, w)| d2 * w).sum();
    let widened = if group.len() >= 3 { (scatter / surplus).max(1.0) } else { 1.0 };
    let mut sum = JointInformation::none();
    for ((seen, share), weight) in group.iter().zip(shares).zip(&weights) {
        // A weight above 1 would claim more information than the window has.
        sum.add(&seen.joint, share * weight.min(1.0) / widened);
    }
    sum
}

/// Condenses several windows of one camera position to one. `None` without usable windows.
#[must_use]
pub fn condense(windows: &[WindowEstimate], options: &FuseOptions) -> Option<WindowEstimate> {
    let usable: Vec<Seen<'_>> = windows.iter().filter_map(Seen::of).collect();
    let first = usable.first()?.window;
    let joint = together(&usable, &shares(&usable, options), options);
    // A very weak prior keeps the numbers finite where the windows have no information. The result's information
    // excludes it.
    let (prior, information) = prior(options);
    let weak = information * 1e-6;
    let camera = with_tilt(&(joint.information + weak).cholesky()?.solve(&(joint.vector + weak * prior)));
    let mut cars: Vec<CarUse> = usable.iter().flat_map(|seen| seen.window.cars.iter().copied()).collect();
    cars.sort_by_key(|used| (used.car, !used.parked));
    cars.dedup_by_key(|used| used.car);
    Some(WindowEstimate {
        span_s: span_s(&usable),
        frames: usable.iter().map(|seen| seen.window.frames).sum(),
        params: CameraParams::from_vector(&camera),
        joint: information_with_tilt(&joint, &camera),
        cars,
        segment: first.segment,
        start: first.start,
        steady: true,
    })
}

/// Returns the first and last time of a group, s.
pub(super) fn span_s(group: &[Seen<'_>]) -> [f64; 2] {
    let spans = || group.iter().map(|seen| seen.window.span_s);
    [
        spans().map(|[from, _]| from).fold(f64::INFINITY, f64::min),
        spans().map(|[_, to]| to).fold(f64::NEG_INFINITY, f64::max),
    ]
}

/// Returns the mean of the windows' middle times, s.
pub(super) fn middle_s(group: &[Seen<'_>]) -> f64 {
    let sum: f64 = group.iter().map(|seen| seen.window.span_s[0] + seen.window.span_s[1]).sum();
    sum / (2 * group.len().max(1)) as f64
}
