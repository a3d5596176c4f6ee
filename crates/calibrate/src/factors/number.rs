//! A measured camera parameter, such as a tilt that the user gives.

use nalgebra::{DMatrix, DVector, Vector4};

use super::Component;

/// A measurement of one camera parameter: log focal (px), tilt (rad), roll (rad) or log height (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number {
    /// Index of the parameter, 0–3.
    pub which: usize,
    /// Measured value, in the parameter's unit.
    pub value: f64,
    /// Sd of the value, above 0.
    pub sd: f64,
}

impl Number {
    pub(super) fn value(&self, camera: &Vector4<f64>) -> DVector<f64> {
        DVector::from_element(1, self.value - camera[self.which])
    }

    pub(super) fn components(&self) -> Vec<Component> {
        vec![Component { share: 1.0, information: DMatrix::from_element(1, 1, self.sd.powi(-2)) }]
    }
}
