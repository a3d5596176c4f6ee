//! Forward and backward over pieces of evidence in time: Kalman filter in information form, Rauch–Tung–Striebel smoother.

use nalgebra::{Matrix4, Vector4};

use crate::FusePrior;

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

/// Evidence `N(information⁻¹ · weighted, information⁻¹)`, possibly singular, and the step that leads to it.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub information: Matrix4<f64>,
    pub weighted: Vector4<f64>,
    pub step: Step,
}

/// Mean and covariance.
pub(crate) type Gaussian = (Vector4<f64>, Matrix4<f64>);

/// Mean and covariance at each node given all of them and the prior.
pub(crate) fn smooth(nodes: &[Node], prior: &FusePrior) -> Vec<Gaussian> {
    let start = (prior.params.to_vector(), Matrix4::from_diagonal(&prior.sd.map(|sd| sd * sd)));
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
        let kept = Matrix4::from_diagonal(&nodes[i + 1].step.kept);
        let gain = factor.solve(&(kept * filtered[i].1)).transpose();
        let (mean, covariance) = smoothed[i + 1];
        smoothed[i].0 += gain * (mean - predicted[i + 1].0);
        smoothed[i].1 += gain * (covariance - predicted[i + 1].1) * gain.transpose();
        smoothed[i].1 = (smoothed[i].1 + smoothed[i].1.transpose()) / 2.0;
    }
    smoothed
}

fn advance((mean, covariance): &Gaussian, step: &Step, prior: &Gaussian) -> Gaussian {
    let kept = Matrix4::from_diagonal(&step.kept);
    let anew = Vector4::repeat(1.0) - step.kept;
    let variance = step.variance + anew.component_mul(&prior.1.diagonal());
    (kept * mean + anew.component_mul(&prior.0), kept * covariance * kept + Matrix4::from_diagonal(&variance))
}

fn update((mean, covariance): &Gaussian, node: &Node) -> Gaussian {
    let Some(before) = covariance.cholesky().map(|c| c.inverse()) else { return (*mean, *covariance) };
    let Some(factor) = (before + node.information).cholesky() else { return (*mean, *covariance) };
    (factor.solve(&(before * mean + node.weighted)), factor.inverse())
}
