//! The evidence of windows that have one constant camera.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, JointInformation, StudentT, weighted_median};

use super::options::FuseOptions;
use super::window::{CarIdentity, CarUse, WindowEstimate};

/// Correlation of the keypoint bias between two views of a moving car, in one window or in two.
pub(crate) const VIEW_CORRELATION: f64 = 0.25;

/// Returns whether a window has finite numbers and no negative information.
pub(super) fn is_usable(window: &WindowEstimate) -> bool {
    let joint = &window.joint;
    let finite = window.params.to_vector().iter().chain(joint.vector.iter()).all(|x| x.is_finite())
        && joint.information.iter().chain(joint.cross.iter()).all(|x| x.is_finite());
    finite && window.span_s.iter().all(|t| t.is_finite()) && joint.information.diagonal().min() >= 0.0
}

/// Returns the share of each window's evidence that other windows of the group do not already contain, 0–1.
fn shares(group: &[&WindowEstimate]) -> Vec<f64> {
    let mut windows_of: BTreeMap<CarIdentity, f64> = BTreeMap::new();
    for window in group {
        for car in window.cars.iter().map(|used| used.car).collect::<BTreeSet<_>>() {
            *windows_of.entry(car).or_default() += 1.0;
        }
    }
    let share = |window: &&WindowEstimate| {
        let of_car = |used: &CarUse| {
            let correlation = if used.parked { 1.0 } else { VIEW_CORRELATION };
            1.0 / (1.0 + (windows_of.get(&used.car).copied().unwrap_or(1.0) - 1.0) * correlation)
        };
        let total: f64 = window.cars.iter().map(of_car).sum();
        if window.cars.is_empty() { 1.0 / group.len() as f64 } else { total / window.cars.len() as f64 }
    };
    group.iter().map(share).collect()
}

/// Returns the joint evidence of a group under one constant camera, by a robust fit.
///
/// If windows scatter more than their covariances allow, the covariance is widened (Birge's ratio).
pub(super) fn together(group: &[&WindowEstimate], options: &FuseOptions) -> JointInformation {
    let shares = shares(group);
    let prior_information = Matrix4::from_diagonal(&options.prior_sd.map(|sd| 1.0 / (sd * sd)));
    let prior = options.prior.to_vector();
    let mut centre = Vector4::from_fn(|i, _| {
        let mut values: Vec<(f64, f64)> = group
            .iter()
            .zip(&shares)
            .map(|(w, share)| (w.params.to_vector()[i], share * w.joint.information[(i, i)]))
            .collect();
        weighted_median(&mut values).unwrap_or(prior[i])
    });
    let distance = |window: &WindowEstimate, centre: &Vector4<f64>| {
        let away = window.params.to_vector() - centre;
        away.dot(&(window.joint.information * away)).max(0.0)
    };
    // Squared Mahalanobis distance of each window from the centre, and its Student-t weight: a window with a wrong minimum
    // counts little.
    let mut distances = Vec::new();
    let mut weights = Vec::new();
    for _ in 0..30 {
        distances = group.iter().map(|window| distance(window, &centre)).collect();
        weights = distances.iter().map(|d2| StudentT { dimensions: 4.0 }.weight(*d2)).collect();
        let mut information = prior_information;
        let mut sum = prior_information * prior;
        for ((window, share), weight) in group.iter().zip(&shares).zip(&weights) {
            let own = window.joint.information * (share * weight);
            information += own;
            sum += own * window.params.to_vector();
        }
        let Some(next) = information.cholesky().map(|c| c.solve(&sum)) else { break };
        let moved = (next - centre).norm();
        centre = next;
        if moved < 1e-12 {
            break;
        }
    }
    let surplus = 4.0 * (group.len() as f64 - 1.0);
    let scatter: f64 = distances.iter().zip(&weights).map(|(d2, w)| d2 * w).sum();
    let widened = if group.len() >= 3 { (scatter / surplus).max(1.0) } else { 1.0 };
    let mut sum = JointInformation::none();
    for ((window, share), weight) in group.iter().zip(&shares).zip(&weights) {
        // A weight above 1 would claim more information than the window has.
        sum.add(&window.joint, share * weight.min(1.0) / widened);
    }
    sum
}

/// Condenses several windows of one camera position to one. `None` without usable windows.
#[must_use]
pub fn condense(windows: &[WindowEstimate], options: &FuseOptions) -> Option<WindowEstimate> {
    let usable: Vec<&WindowEstimate> = windows.iter().filter(|window| is_usable(window)).collect();
    let first = *usable.first()?;
    let joint = together(&usable, options);
    let mut cars: Vec<CarUse> = usable.iter().flat_map(|window| window.cars.iter().copied()).collect();
    cars.sort_by_key(|used| (used.car, !used.parked));
    cars.dedup_by_key(|used| used.car);
    Some(WindowEstimate {
        span_s: span_s(&usable),
        frames: usable.iter().map(|window| window.frames).sum(),
        params: CameraParams::from_vector(&mean(&joint, options)?),
        joint,
        cars,
        position: first.position,
    })
}

/// Returns the mean of evidence, which may be singular.
///
/// A very weak prior keeps the numbers finite where there is no information.
pub(super) fn mean(joint: &JointInformation, options: &FuseOptions) -> Option<Vector4<f64>> {
    let weak = Matrix4::from_diagonal(&options.prior_sd.map(|sd| 1e-6 / (sd * sd)));
    let weighted = joint.vector + weak * options.prior.to_vector();
    Some((joint.information + weak).cholesky()?.solve(&weighted))
}

/// Returns the first and last time of a group, s.
pub(super) fn span_s(group: &[&WindowEstimate]) -> [f64; 2] {
    let spans = || group.iter().map(|window| window.span_s);
    [
        spans().map(|[from, _]| from).fold(f64::INFINITY, f64::min),
        spans().map(|[_, to]| to).fold(f64::NEG_INFINITY, f64::max),
    ]
}
