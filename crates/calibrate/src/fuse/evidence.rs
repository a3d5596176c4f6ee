//! Evidence on the camera as a Gaussian, and the evidence of factors.

use nalgebra::{Matrix4, Vector4};

use crate::factors::{Component, Factor, Residual};

/// Evidence on four numbers as a Gaussian `N(information⁻¹ · weighted, information⁻¹)`; it may be singular.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evidence {
    /// Information matrix, the inverse of the covariance.
    pub information: Matrix4<f64>,
    /// Information matrix times the mean.
    pub weighted: Vector4<f64>,
}

impl Evidence {
    /// Returns evidence without information.
    pub(super) fn none() -> Self {
        Self { information: Matrix4::zeros(), weighted: Vector4::zeros() }
    }

    /// Returns the evidence of a factor, linearised at the camera `at`. `rest` is the evidence of everything else.
    ///
    /// A factor whose error is a mixture leaves a mixture of Gaussians. The result combines with `rest` to one Gaussian
    /// with the mean and covariance of that mixture (expectation propagation, Minka 2001). A factor that cannot be
    /// evaluated gives no evidence.
    pub(super) fn of_factor(factor: &Factor, at: &Vector4<f64>, rest: Option<&Self>) -> Self {
        let Some(residual) = factor.residual(at) else { return Self::none() };
        let mixed = || Self::of_mixture(&residual, at, rest.filter(|_| residual.components.len() > 1)?);
        mixed().unwrap_or_else(|| Self::of_mean(&residual, at))
    }

    /// Returns the evidence of the components' mean information, weighted by their densities at `at`.
    fn of_mean(Residual { value, by_camera, components }: &Residual, at: &Vector4<f64>) -> Self {
        let densities: Vec<f64> = components.iter().map(|component| component.density(value)).collect();
        let total: f64 = densities.iter().sum();
        let mut evidence = Self::none();
        for (component, density) in components.iter().zip(densities) {
            // A single component counts fully, even if its density is too small for a number.
            let weight = if components.len() == 1 { 1.0 } else { density / total.max(f64::MIN_POSITIVE) };
            let gain = by_camera.transpose() * &component.information * weight;
            evidence.information += &gain * by_camera;
            evidence.weighted -= gain * value;
        }
        evidence.information = (evidence.information + evidence.information.transpose()) / 2.0;
        evidence.weighted += evidence.information * at;
        evidence
    }

    /// Returns the evidence of a mixture beside the evidence `rest`; `None` where a matrix has no inverse.
    fn of_mixture(residual: &Residual, at: &Vector4<f64>, rest: &Self) -> Option<Self> {
        let (expected, spread) = rest.moments()?;
        let by = &residual.by_camera;
        let surprise = &residual.value + by * (expected - at);
        let mut posteriors: Vec<(f64, Vector4<f64>, Matrix4<f64>)> =
            Vec::with_capacity(residual.components.len());
        for component in &residual.components {
            let covariance = component.information.clone().try_inverse()? + by * spread * by.transpose();
            let predicted = Component { share: component.share, information: covariance.try_inverse()? };
            let gain = -spread * by.transpose() * &predicted.information;
            posteriors.push((
                predicted.density(&surprise),
                expected + &gain * &surprise,
                spread + gain * by * spread,
            ));
        }
        let total: f64 = posteriors.iter().map(|(weight, ..)| weight).sum();
        let mean = posteriors.iter().map(|(weight, mean, _)| mean * (weight / total)).sum::<Vector4<f64>>();
        let covariance = posteriors.iter().map(|(weight, own, covariance)| {
            let off = own - mean;
            (covariance + off * off.transpose()) * (weight / total)
        });
        let covariance = covariance.sum::<Matrix4<f64>>();
        let information = ((covariance + covariance.transpose()) / 2.0).cholesky()?.inverse();
        Some(Self { information, weighted: information * mean }.without(rest))
    }

    /// Converts the evidence to other coordinates. `from` and `to` are the same camera in the old and in the new
    /// coordinates. `by` is the derivative of the old coordinates by the new ones there.
    pub(super) fn moved(&self, by: &Matrix4<f64>, from: &Vector4<f64>, to: &Vector4<f64>) -> Self {
        let information = by.transpose() * self.information * by;
        let information = (information + information.transpose()) / 2.0;
        let pull = by.transpose() * (self.weighted - self.information * from);
        Self { information, weighted: information * to + pull }
    }

    /// Returns the mean and covariance; `None` where the information is singular.
    fn moments(&self) -> Option<(Vector4<f64>, Matrix4<f64>)> {
        let cholesky = self.information.cholesky()?;
        Some((cholesky.solve(&self.weighted), cholesky.inverse()))
    }

    /// Returns this evidence with `other` subtracted.
    pub(super) fn without(&self, other: &Self) -> Self {
        Self { information: self.information - other.information, weighted: self.weighted - other.weighted }
    }

    /// Returns this evidence with `other` added.
    pub(super) fn and(&self, other: &Self) -> Self {
        Self { information: self.information + other.information, weighted: self.weighted + other.weighted }
    }
}
