//! Prior and factors on the camera, and their terms in the camera's equations.

use std::sync::Arc;

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{Factor, FactorTerms, is_determined};

/// Prior of (log f, tilt, roll, log h), and factors.
#[derive(Clone, Debug)]
pub(crate) struct CameraKnowledge {
    /// Mean of the prior.
    pub mean: Vector4<f64>,
    /// Information (1/sd²) per parameter; 0 without a prior.
    pub information: Vector4<f64>,
    /// Parameters that are not estimated.
    pub fixed: [bool; 4],
    /// Factors on the camera beside the cars.
    pub factors: Arc<[Factor]>,
}

impl CameraKnowledge {
    /// Creates a camera that is given, not estimated.
    pub fn given(camera: Vector4<f64>) -> Self {
        Self { mean: camera, information: Vector4::zeros(), fixed: [true; 4], factors: Arc::new([]) }
    }

    /// Returns the cost of prior and factors at a camera.
    pub fn cost(&self, camera: &Vector4<f64>) -> f64 {
        let off = camera - self.mean;
        let factors: f64 = self.factors.iter().map(|factor| factor.cost(camera)).sum();
        0.5 * off.component_mul(&self.information).dot(&off) + factors
    }

    /// Returns gradient and approximate Hessian of the cost at a camera.
    pub fn terms(&self, camera: &Vector4<f64>) -> FactorTerms {
        let mut terms = FactorTerms::of(self.factors.iter(), camera);
        terms.gradient += (camera - self.mean).component_mul(&self.information);
        terms.information += Matrix4::from_diagonal(&self.information);
        terms
    }

    /// Whether cars with this information and the factors determine the focal length better than the prior.
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

    /// Returns the camera's covariance from the cars' information, prior and factors; rows of fixed parameters are
    /// zero.
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
