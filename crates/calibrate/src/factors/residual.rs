//! The residual of a factor, and the distribution of its error.

use nalgebra::{DMatrix, DVector, MatrixXx4};

/// One Gaussian component of the error of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Component {
    /// Prior probability of the component, 0–1.
    pub share: f64,
    /// Inverse covariance of the residual.
    pub information: DMatrix<f64>,
}

/// The residual of a factor at a camera, and the distribution of its error.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Residual {
    /// Measured value minus the value that the camera predicts, in the factor's units.
    pub value: DVector<f64>,
    /// Derivative of `value` by (log f, tilt, roll, log h).
    pub by_camera: MatrixXx4<f64>,
    /// Components of the error. Their shares add up to 1.
    pub components: Vec<Component>,
}

impl Component {
    /// Returns the density of a residual times `share`, up to a constant factor.
    pub fn density(&self, residual: &DVector<f64>) -> f64 {
        let distance = residual.dot(&(&self.information * residual));
        self.share * (-0.5 * distance).exp() * self.information.determinant().max(0.0).sqrt()
    }
}
