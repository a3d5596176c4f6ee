//! Forward and backward over pieces of evidence in time: Kalman filter in information form, Rauch–Tung–Striebel smoother.
//!
//! The state is (log f, tilt, roll, log h', log s): how large the place's cars are against the atlas, s, is the same at all times,
//! and cars tell the height h' = h / s that the camera would have were they of the atlas' sizes. What tells lengths in metres tells
//! h = h' s, and so s.

use nalgebra::{Matrix4, SMatrix, SVector, Vector4};
use roadplane_base::{Factor, FactorTerms, Reading};

use crate::prior::FusePrior;

/// What happens to the camera before a piece of evidence, number by number: kept ones (1) gain `variance`, others (0) start
/// again from the prior.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    pub kept: Vector4<f64>,
    pub variance: Vector4<f64>,
}

impl Step {
    pub(crate) fn fresh() -> Self {
        Self { kept: Vector4::zeros(), variance: Vector4::zeros() }
    }

    pub(crate) fn kept(variance: Vector4<f64>) -> Self {
        Self { kept: Vector4::repeat(1.0), variance }
    }
}

/// Camera and size of the cars.
type State = SVector<f64, 5>;
type Square = SMatrix<f64, 5, 5>;

/// Evidence `N(information⁻¹ · weighted, information⁻¹)`, possibly singular.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Evidence {
    pub information: Matrix4<f64>,
    pub weighted: Vector4<f64>,
}

impl Evidence {
    pub(crate) fn none() -> Self {
        Self { information: Matrix4::zeros(), weighted: Vector4::zeros() }
    }

    /// What a factor says beside all else that is known of the camera (mean and covariance), linearised at a camera.
    ///
    /// One that may mean two things leaves two Gaussians; it says what makes one of them, of their mean and covariance
    /// (expectation propagation, Minka 2001).
    pub(crate) fn of_factor(factor: &Factor, at: &Vector4<f64>, rest: Option<&Self>) -> Self {
        let FactorTerms { gradient, information } = FactorTerms::of([factor], at);
        let linear = Self { information, weighted: information * at - gradient };
        let Some((readings, rest)) = factor.readings(at).zip(rest) else { return linear };
        Self::of_readings(&readings, &factor.residual_by_camera(at), at, rest).unwrap_or(linear)
    }

    fn of_readings(
        readings: &[Reading],
        by: &SMatrix<f64, 2, 4>,
        at: &Vector4<f64>,
        rest: &Self,
    ) -> Option<Self> {
        let (expected, spread) = rest.moments()?;
        let mut told: Vec<(f64, Vector4<f64>, Matrix4<f64>)> = Vec::with_capacity(readings.len());
        for reading in readings {
            let surprise = reading.residual + by * (expected - at);
            let covariance = reading.covariance + by * spread * by.transpose();
            let (weight, information) = Reading { residual: surprise, covariance, ..*reading }.density()?;
            let gain = -spread * by.transpose() * information;
            told.push((weight, expected + gain * surprise, spread + gain * by * spread));
        }
        let total: f64 = told.iter().map(|(weight, ..)| weight).sum();
        let mean = told.iter().map(|(weight, mean, _)| mean * (weight / total)).sum::<Vector4<f64>>();
        let covariance = told.iter().map(|(weight, own, covariance)| {
            let off = own - mean;
            (covariance + off * off.transpose()) * (weight / total)
        });
        let covariance = covariance.sum::<Matrix4<f64>>();
        let information = ((covariance + covariance.transpose()) / 2.0).cholesky()?.inverse();
        Some(Self { information, weighted: information * mean }.without(rest))
    }

    /// As one Gaussian; `None` where it does not say all.
    fn moments(&self) -> Option<(Vector4<f64>, Matrix4<f64>)> {
        let factor = self.information.cholesky()?;
        Some((factor.solve(&self.weighted), factor.inverse()))
    }

    pub(crate) fn without(&self, other: &Self) -> Self {
        Self { information: self.information - other.information, weighted: self.weighted - other.weighted }
    }

    pub(crate) fn and(&self, other: &Self) -> Self {
        Self { information: self.information + other.information, weighted: self.weighted + other.weighted }
    }
}

/// Evidence of (log f, tilt, roll, log h') by cars and of (log f, tilt, roll, log h) by what is in metres, and the step that leads to
/// it.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub cars: Evidence,
    pub metres: Evidence,
    pub step: Step,
}

/// Mean and covariance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gaussian(State, Square);

impl Gaussian {
    /// Of (log f, tilt, roll, log h).
    pub(crate) fn camera(&self) -> (Vector4<f64>, Matrix4<f64>) {
        let into = into_metres();
        (into * self.0, into * self.1 * into.transpose())
    }

    /// All that is known of (log f, tilt, roll, log h).
    pub(crate) fn evidence(&self) -> Option<Evidence> {
        let (mean, covariance) = self.camera();
        let information = covariance.cholesky()?.inverse();
        Some(Evidence { information, weighted: information * mean })
    }

    /// (log f, tilt, roll, log h'): with cars of the atlas' sizes.
    pub(crate) fn by_cars(&self) -> Vector4<f64> {
        self.0.fixed_rows::<4>(0).into_owned()
    }

    /// Log of how large cars are against the atlas.
    pub(crate) fn size_of_cars(&self) -> f64 {
        self.0[4]
    }
}

/// Turns the state into (log f, tilt, roll, log h).
fn into_metres() -> SMatrix<f64, 4, 5> {
    let mut into = SMatrix::<f64, 4, 5>::identity();
    into[(3, 4)] = 1.0;
    into
}

/// Least variance of log s, so that matrices have inverses.
const LEAST_VARIANCE: f64 = 1e-12;

/// What is believed at each node given all of them, the prior of the camera, and the sd of log s.
pub(crate) fn smooth(nodes: &[Node], prior: &FusePrior, size_sd: f64) -> Vec<Gaussian> {
    let variance = prior.sd.map(|sd| sd * sd).push((size_sd * size_sd).max(LEAST_VARIANCE));
    let start = Gaussian(prior.params.to_vector().push(0.0), Square::from_diagonal(&variance));
    let mut predicted: Vec<Gaussian> = Vec::with_capacity(nodes.len());
    let mut filtered: Vec<Gaussian> = Vec::with_capacity(nodes.len());
    for node in nodes {
        let before = filtered.last().map_or(start, |last| advance(last, &node.step, &start));
        filtered.push(update(&before, node));
        predicted.push(before);
    }
    let mut smoothed = filtered.clone();
    for i in (0..nodes.len().saturating_sub(1)).rev() {
        let Some(factor) = predicted[i + 1].1.cholesky() else { continue };
        let kept = Square::from_diagonal(&nodes[i + 1].step.kept.push(1.0));
        let gain = factor.solve(&(kept * filtered[i].1)).transpose();
        let Gaussian(mean, covariance) = smoothed[i + 1];
        smoothed[i].0 += gain * (mean - predicted[i + 1].0);
        smoothed[i].1 += gain * (covariance - predicted[i + 1].1) * gain.transpose();
        smoothed[i].1 = (smoothed[i].1 + smoothed[i].1.transpose()) / 2.0;
    }
    smoothed
}

fn advance(Gaussian(mean, covariance): &Gaussian, step: &Step, prior: &Gaussian) -> Gaussian {
    let kept = step.kept.push(1.0);
    let anew = State::repeat(1.0) - kept;
    let variance = step.variance.push(0.0) + anew.component_mul(&prior.1.diagonal());
    let kept = Square::from_diagonal(&kept);
    Gaussian(
        kept * mean + anew.component_mul(&prior.0),
        kept * covariance * kept + Square::from_diagonal(&variance),
    )
}

fn update(before: &Gaussian, Node { cars, metres, .. }: &Node) -> Gaussian {
    let into = into_metres();
    let Some(prior) = before.1.cholesky().map(|c| c.inverse()) else { return *before };
    let mut information = prior + into.transpose() * metres.information * into;
    let mut of_camera = information.fixed_view_mut::<4, 4>(0, 0);
    of_camera += cars.information;
    let Some(factor) = information.cholesky() else { return *before };
    let weighted = prior * before.0 + cars.weighted.push(0.0) + into.transpose() * metres.weighted;
    Gaussian(factor.solve(&weighted), factor.inverse())
}
