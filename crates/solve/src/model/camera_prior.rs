//! Prior on the camera, with its part of the camera's normal equations.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::is_determined;

/// A Gaussian prior on the camera (log f, tilt, roll, log h).
#[derive(Clone, Debug)]
pub(crate) struct CameraKnowledge {
    /// Mean of the prior.
    pub mean: Vector4<f64>,
    /// Information (1/sd²) of the prior on each parameter; 0 if the parameter has no prior.
    pub information: Vector4<f64>,
    /// Whether each parameter is fixed instead of estimated.
    pub fixed: [bool; 4],
}

impl CameraKnowledge {
    /// Fixes all parameters at the given camera.
    pub fn given(camera: Vector4<f64>) -> Self {
        Self { mean: camera, information: Vector4::zeros(), fixed: [true; 4] }
    }

    /// Returns the cost of a camera under the prior.
    pub fn cost(&self, camera: &Vector4<f64>) -> f64 {
        let off = camera - self.mean;
        0.5 * off.component_mul(&self.information).dot(&off)
    }

    /// Returns the gradient of the cost with respect to the camera. The Hessian is the diagonal `information`.
    pub fn gradient(&self, camera: &Vector4<f64>) -> Vector4<f64> {
        (camera - self.mean).component_mul(&self.information)
    }

    /// Whether cars determine the focal length better than the prior does.
    ///
    /// `cars` is the cars' information on the camera.
    pub fn is_focal_determined(&self, cars: &Matrix4<f64>) -> bool {
        is_determined(0, cars, &self.information)
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
    /// `information` is the cars' information on the camera. The information of the prior is added. Returns `None` if
    /// the sum is singular.
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
