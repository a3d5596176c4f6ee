//! One shape per track. Looks from the same place share their bias and count as one view together; views add up, and the
//! atlas' prior is counted once:
//!
//! ```text
//! I = 1 + Σ_views mean(I_i − 1),    λ = I⁻¹ Σ_views mean(I_i λ_i)
//! ```

use nalgebra::{Matrix6, Vector2};
use roadplane_base::Shape;

use crate::{CarMeasurement, filter::fold_axis};

/// A view ends when the car moved so far, m …
const VIEW_M: f64 = 2.0;
/// … or turned so far, rad (10°).
const VIEW_TURN: f64 = 0.175;

/// Running sums of a track's evidence on its shape; memory does not grow with its length.
#[derive(Clone, Debug)]
pub(crate) struct ShapeSum {
    information: Matrix6<f64>,
    weighted: Shape,
    view: View,
}

#[derive(Clone, Debug)]
struct View {
    position: Vector2<f64>,
    axis: f64,
    information: Matrix6<f64>,
    weighted: Shape,
    looks: f64,
}

impl View {
    fn new(position: Vector2<f64>, axis: f64) -> Self {
        Self { position, axis, information: Matrix6::zeros(), weighted: Shape::zeros(), looks: 0.0 }
    }
}

impl ShapeSum {
    pub(crate) fn new(position: Vector2<f64>, axis: f64) -> Self {
        Self { information: Matrix6::zeros(), weighted: Shape::zeros(), view: View::new(position, axis) }
    }

    /// Adds a look from where the track's filter says that the car is.
    pub(crate) fn add(&mut self, car: &CarMeasurement, position: Vector2<f64>, axis: f64) {
        let turned = fold_axis(axis - self.view.axis).abs();
        if (position - self.view.position).norm() > VIEW_M || turned > VIEW_TURN {
            let ended = std::mem::replace(&mut self.view, View::new(position, axis));
            self.information += ended.information / ended.looks.max(1.0);
            self.weighted += ended.weighted / ended.looks.max(1.0);
        }
        self.view.information += car.shape_information - Matrix6::identity();
        self.view.weighted += car.shape_information * car.shape;
        self.view.looks += 1.0;
    }

    /// Shape and information; the prior alone where the sums are no information matrix.
    pub(crate) fn fused(&self) -> (Shape, Matrix6<f64>) {
        let looks = self.view.looks.max(1.0);
        let sum = Matrix6::identity() + self.information + self.view.information / looks;
        let information = (sum + sum.transpose()) / 2.0;
        let weighted = self.weighted + self.view.weighted / looks;
        match information.cholesky() {
            Some(factor) => (factor.solve(&weighted), information),
            None => (Shape::zeros(), Matrix6::identity()),
        }
    }
}
