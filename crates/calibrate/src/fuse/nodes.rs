//! Kalman filter in information form and Rauch–Tung–Striebel smoother over the camera positions.
//!
//! The state is (log f, tilt, roll, log h', log s). The size s of the site's cars relative to the atlas is the same at
//! all positions. Cars determine the height h' = h / s that the camera would have if they had the atlas's sizes. Factors in
//! metres determine h = h' s, and so s.

use nalgebra::{Matrix4, SMatrix, SVector, Vector4};

use super::evidence::Evidence;
use super::options::{FuseOptions, LEAST_SD};

/// The state (log f, tilt, roll, log h', log s): the camera and the size of the cars.
type State = SVector<f64, 5>;
/// A covariance or information matrix of the state.
type Square = SMatrix<f64, 5, 5>;

/// The evidence of one camera position.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Evidence of (log f, tilt, roll, log h') from cars.
    pub cars: Evidence,
    /// Evidence of (log f, tilt, roll, log h) from factors in metres.
    pub metres: Evidence,
}

/// A Gaussian of the state: mean and covariance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gaussian(State, Square);

impl Gaussian {
    /// Returns the mean and covariance of (log f, tilt, roll, log h), with h in metres.
    pub(super) fn camera(&self) -> (Vector4<f64>, Matrix4<f64>) {
        let into = into_metres();
        (into * self.0, into * self.1 * into.transpose())
    }

    /// Returns the Gaussian as evidence of (log f, tilt, roll, log h); `None` where the covariance is singular.
    pub(super) fn evidence(&self) -> Option<Evidence> {
        let (mean, covariance) = self.camera();
        let information = covariance.cholesky()?.inverse();
        Some(Evidence { information, weighted: information * mean })
    }

    /// Returns the mean of (log f, tilt, roll, log h'), the camera as if cars had the atlas's sizes.
    pub(super) fn by_cars(&self) -> Vector4<f64> {
        self.0.fixed_rows::<4>(0).into_owned()
    }

    /// Returns the log of the cars' size relative to the atlas.
    pub(super) fn size_of_cars(&self) -> f64 {
        self.0[4]
    }
}

/// Returns the 4 × 5 matrix that maps the state to (log f, tilt, roll, log h).
fn into_metres() -> SMatrix<f64, 4, 5> {
    let mut into = SMatrix::<f64, 4, 5>::identity();
    into[(3, 4)] = 1.0;
    into
}

/// Returns the posterior at each node given all nodes. `options` has the priors.
pub(super) fn smooth(nodes: &[Node], options: &FuseOptions) -> Vec<Gaussian> {
    let FuseOptions { prior, prior_sd, size_of_cars_sd, is_folded, .. } = options;
    let variance = prior_sd.map(|sd| sd * sd).push(size_of_cars_sd.max(LEAST_SD).powi(2));
    let start = Gaussian(prior.to_vector().push(0.0), Square::from_diagonal(&variance));
    // 1 for each number that all positions have in common, and 0 for the others.
    let shared = State::new(if *is_folded { 1.0 } else { 0.0 }, 0.0, 0.0, 0.0, 1.0);
    let mut predicted: Vec<Gaussian> = Vec::with_capacity(nodes.len());
    let mut filtered: Vec<Gaussian> = Vec::with_capacity(nodes.len());
    for node in nodes {
        let before = filtered.last().map_or(start, |last| advance(last, &shared, &start));
        filtered.push(update(&before, node));
        predicted.push(before);
    }
    let mut smoothed = filtered.clone();
    let kept = Square::from_diagonal(&shared);
    for i in (0..nodes.len().saturating_sub(1)).rev() {
        let Some(cholesky) = predicted[i + 1].1.cholesky() else { continue };
        let gain = cholesky.solve(&(kept * filtered[i].1)).transpose();
        let Gaussian(mean, covariance) = smoothed[i + 1];
        smoothed[i].0 += gain * (mean - predicted[i + 1].0);
        smoothed[i].1 += gain * (covariance - predicted[i + 1].1) * gain.transpose();
        smoothed[i].1 = (smoothed[i].1 + smoothed[i].1.transpose()) / 2.0;
    }
    smoothed
}

/// Predicts the state of the next node. Numbers that are not `shared` start again from `prior`.
fn advance(Gaussian(mean, covariance): &Gaussian, shared: &State, prior: &Gaussian) -> Gaussian {
    let anew = State::repeat(1.0) - shared;
    let variance = anew.component_mul(&prior.1.diagonal());
    let kept = Square::from_diagonal(shared);
    Gaussian(
        kept * mean + anew.component_mul(&prior.0),
        kept * covariance * kept + Square::from_diagonal(&variance),
    )
}

/// Adds a node's evidence to a predicted state. Where a matrix has no inverse the state is returned unchanged.
fn update(before: &Gaussian, Node { cars, metres, .. }: &Node) -> Gaussian {
    let into = into_metres();
    let Some(prior) = before.1.cholesky().map(|c| c.inverse()) else { return *before };
    let mut information = prior + into.transpose() * metres.information * into;
    let mut of_camera = information.fixed_view_mut::<4, 4>(0, 0);
    of_camera += cars.information;
    let Some(cholesky) = information.cholesky() else { return *before };
    let weighted = prior * before.0 + cars.weighted.push(0.0) + into.transpose() * metres.weighted;
    Gaussian(cholesky.solve(&weighted), cholesky.inverse())
}
