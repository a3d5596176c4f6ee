//! Measured camera parameters: one, such as a tilt that the user gives, or all four, such as a survey.

use nalgebra::{DMatrix, DVector, Matrix4, Vector4};

use super::residual::Component;

/// A measurement of camera parameters: log focal (px), tilt (rad), roll (rad) and log height (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Survey {
    /// Mean of the parameters.
    pub mean: Vector4<f64>,
    /// Inverse covariance of the measurement. It is singular if some parameters were not measured.
    pub information: Matrix4<f64>,
    /// Whether the height was estimated from cars of the same scene.
    ///
    /// If true, the covariance does not include the uncertainty of the mean size of these cars.
    pub by_cars: bool,
}

impl Survey {
    /// Returns the measurement of one parameter, by its index 0–3, with its sd (above 0).
    #[must_use]
    pub fn of_number(which: usize, value: f64, sd: f64) -> Self {
        let information = Matrix4::from_diagonal(&Vector4::ith(which, sd.powi(-2)));
        Self { mean: Vector4::ith(which, value), information, by_cars: false }
    }

    pub(super) fn error(&self, camera: &Vector4<f64>) -> (DVector<f64>, Vec<Component>) {
        let information = DMatrix::from_column_slice(4, 4, self.information.as_slice());
        let value = DVector::from_column_slice((self.mean - camera).as_slice());
        (value, vec![Component { share: 1.0, information }])
    }
}
