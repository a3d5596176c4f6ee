//! What is known of the camera beforehand, and what it does to the camera's equations.

use nalgebra::{Matrix4, Vector4};

/// Prior of (log f, tilt, roll, log h).
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraKnowledge {
    /// Mean of the prior.
    pub mean: Vector4<f64>,
    /// Information (1/sd²) per parameter; 0 where nothing is known.
    pub information: Vector4<f64>,
    /// Parameters that are not estimated.
    pub fixed: [bool; 4],
}

impl CameraKnowledge {
    /// The prior's cost.
    pub fn cost(&self, camera: &Vector4<f64>) -> f64 {
        0.5 * self.gradient(camera).dot(&(camera - self.mean))
    }

    /// Its gradient.
    pub fn gradient(&self, camera: &Vector4<f64>) -> Vector4<f64> {
        (camera - self.mean).component_mul(&self.information)
    }

    /// Makes the equations' solution zero where the camera is fixed.
    pub fn hold_fixed(&self, hessian: &mut Matrix4<f64>, gradient: &mut Vector4<f64>) {
        for i in (0..4).filter(|i| self.fixed[*i]) {
            hessian.row_mut(i).fill(0.0);
            hessian.column_mut(i).fill(0.0);
            hessian[(i, i)] = 1.0;
            gradient[i] = 0.0;
        }
    }

    /// Covariance of the camera by what cars say of it and the prior; zero rows where fixed.
    pub fn covariance(&self, information: &Matrix4<f64>) -> Option<Matrix4<f64>> {
        let mut total = information + Matrix4::from_diagonal(&self.information);
        self.hold_fixed(&mut total, &mut Vector4::zeros());
        let mut covariance = total.cholesky()?.inverse();
        for i in (0..4).filter(|i| self.fixed[*i]) {
            covariance[(i, i)] = 0.0;
        }
        Some(covariance)
    }
}
