//! Prior on the camera and further cost terms (factors), with their parts of the camera's normal equations.

use std::sync::Arc;

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{Factor, FactorTerms, is_determined};

/// Evidence on the camera (log f, tilt, roll, log h) that does not come from cars: a Gaussian prior, and factors.
#[derive(Clone, Debug)]
pub(crate) struct CameraKnowledge {
    /// Mean of the prior.
    pub mean: Vector4<f64>,
    /// Information (1/sd²) of the prior on each parameter; 0 if the parameter has no prior.
    pub information: Vector4<f64>,
    /// Whether each parameter is fixed instead of estimated.
    pub fixed: [bool; 4],
    /// Further cost terms on the camera, such as a tilt that the user gives.
    pub factors: Arc<[Factor]>,
}

impl CameraKnowledge {
    /// Fixes all parameters at the given camera.
    pub fn given(camera: Vector4<f64>) -> Self {
        Self { mean: camera, information: Vector4::zeros(), fixed: [true; 4], factors: Arc::new([]) }
    }

    /// Returns the cost of a camera under the prior and the factors.
    pub fn cost(&self, camera: &Vector4<f64>) -> f64 {
        let off = camera - self.mean;
        let factors: f64 = self.factors.iter().map(|factor| factor.cost(camera)).sum();
        0.5 * off.component_mul(&self.information).dot(&off) + factors
    }

    /// Returns gradient and approximate Hessian of the cost of prior and factors with respect to the camera.
    pub fn terms(&self, camera: &Vector4<f64>) -> FactorTerms {
        let mut terms = FactorTerms::of(self.factors.iter(), camera);
        terms.gradient += (camera - self.mean).component_mul(&self.information);
        terms.information += Matrix4::from_diagonal(&self.information);
        terms
    }

    /// Whether cars and factors together determine the focal length better than the prior does.
    ///
    /// `cars` is the cars' information on the camera.
    pub fn is_focal_determined(&self, cars: &Matrix4<f64>, camera: &Vector4<f64>) -> bool {
        let factors = FactorTerms::of(self.factors.iter(), camera).information;
        is_determined(0, &(cars + factors), &self.information)
    }

    /// Changes the equations so that the steps of fixed parameters are zero.
    pub fn hold_fixed(&self, hessian: &mut Matrix4<f64>, gradient: &mut Vector4<f64>) {
        for i in (0..4).filter(|i| self.fixed[*i]) {
            hessian.row_mut(i).fill(0.0);
            hessian.column_mut(i).fill(0.0);
            hessian[(i, i)] = 1.0;
            gradient[i] = 0.0;
        }
    }

    /// Returns the camera's covariance; rows of fixed parameters are zero.
    ///
    /// `information` is the cars' information on the camera. The information of prior and factors is added. Returns
    /// `None` if the sum is singular.
    pub fn covariance(&self, information: &Matrix4<f64>, camera: &Vector4<f64>) -> Option<Matrix4<f64>> {
        let mut total = information + self.terms(camera).information;
        self.hold_fixed(&mut total, &mut Vector4::zeros());
        let mut covariance = total.cholesky()?.inverse();
        for i in (0..4).filter(|i| self.fixed[*i]) {
            covariance[(i, i)] = 0.0;
        }
        Some(covariance)
    }
}
