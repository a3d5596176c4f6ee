//! An estimate of the whole camera from another source, such as a survey.

use nalgebra::{DMatrix, DVector, Matrix4, Vector4};

use super::Component;

/// An estimate of all four camera parameters from another source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Survey {
    /// Mean of (log focal, tilt, roll, log height).
    pub mean: Vector4<f64>,
    /// Inverse covariance of the estimate. It may be singular.
    pub information: Matrix4<f64>,
    /// Whether the height was estimated from cars of the same scene.
    ///
    /// If true, the covariance does not include the uncertainty of the mean size of these cars.
    pub by_cars: bool,
}

impl Survey {
    pub(super) fn value(&self, camera: &Vector4<f64>) -> DVector<f64> {
        DVector::from_column_slice((self.mean - camera).as_slice())
    }

    pub(super) fn components(&self) -> Vec<Component> {
        let information = DMatrix::from_column_slice(4, 4, self.information.as_slice());
        vec![Component { share: 1.0, information }]
    }
}
