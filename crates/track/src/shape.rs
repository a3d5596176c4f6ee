//! One shape per track. Looks from the same place share their bias and count as one view together; views add up, and the
//! atlas' prior is counted once:
//!
//! ```text
//! I = 1 + Σ_views mean(I_i − 1),    λ = I⁻¹ Σ_views mean(I_i λ_i)
//! ```

use nalgebra::{Matrix6, Vector2};
use roadplane_base::{Shape, fold_axis};

use crate::CarMeasurement;

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
        let evidence = car.shape_information - Matrix6::identity();
        // Less than the prior is no evidence; added up it would blow the shape up instead of holding it.
        if (evidence + Matrix6::identity() * 1e-6).cholesky().is_some() {
            self.view.information += evidence;
            self.view.weighted += car.shape_information * car.shape;
            self.view.looks += 1.0;
        }
    }

    /// Adds all that another track saw of the same car.
    pub(crate) fn append(&mut self, other: Self) {
        for view in [other.view, std::mem::replace(&mut self.view, View::new(Vector2::zeros(), 0.0))] {
            self.information += view.information / view.looks.max(1.0);
            self.weighted += view.weighted / view.looks.max(1.0);
        }
        self.information += other.information;
        self.weighted += other.weighted;
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

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{GroundPose, VehicleClass};

    fn look(shape: f64, information: f64) -> CarMeasurement {
        CarMeasurement {
            pose: GroundPose { x_m: 0.0, y_m: 20.0, heading_rad: 0.0 },
            covariance: nalgebra::Matrix3::identity(),
            bbox_px: [0.0, 0.0, 10.0, 10.0],
            score: 1.0,
            class: VehicleClass::Car,
            shape: Shape::repeat(shape),
            shape_information: Matrix6::identity() * information,
            car: 0,
            from_box: false,
            cut: [false; 4],
            hidden: [false; 4],
            known: false,
            dims_m: None,
        }
    }

    #[test]
    fn looks_from_one_place_count_once_and_views_add_up() {
        let at = Vector2::new(0.0, 20.0);
        let mut sum = ShapeSum::new(at, 0.0);
        (0..100).for_each(|_| sum.add(&look(1.5, 4.0), at, 0.0));
        let (shape, information) = sum.fused();
        assert!((shape - Shape::repeat(1.5)).norm() < 1e-12 && (information[(0, 0)] - 4.0).abs() < 1e-12);
        // Three metres on: as much evidence again, of (4 · 1.5) / 3 = 2 without the prior.
        sum.add(&look(1.5, 4.0), at + Vector2::new(3.0, 0.0), 0.0);
        let (shape, information) = sum.fused();
        assert!((shape[0] - 12.0 / 7.0).abs() < 1e-12 && (information[(0, 0)] - 7.0).abs() < 1e-12);
    }

    #[test]
    fn information_below_the_prior_is_left_out() {
        let at = Vector2::new(0.0, 20.0);
        let mut sum = ShapeSum::new(at, 0.0);
        (0..9).for_each(|_| sum.add(&look(3.0, 0.01), at, 0.0));
        assert!(sum.fused().0.norm() < 1e-12);
    }

    #[test]
    fn a_shape_that_is_held_stays_what_it_is() {
        let mut sum = ShapeSum::new(Vector2::new(0.0, 20.0), 0.0);
        (0..10).for_each(|i| sum.add(&look(1.5, 1e6), Vector2::new(0.0, 20.0 + 5.0 * f64::from(i)), 0.0));
        assert!((sum.fused().0 - Shape::repeat(1.5)).norm() < 1e-5);
    }
}
