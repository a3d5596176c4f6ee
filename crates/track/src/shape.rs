//! One shape per track. Looks from the same place share their bias and count as one view together; views add up, and what
//! was known before the looks, N(m_i, Λ_i⁻¹), is counted once:
//!
//! ```text
//! I = mean(Λ_i) + Σ_views mean(I_i − Λ_i),    I λ = mean(Λ_i m_i) + Σ_views mean(I_i λ_i − Λ_i m_i)
//! ```

use nalgebra::{Matrix6, Vector2};
use roadplane_base::{Shape, fold_axis};

use crate::{CarMeasurement, ShapeBelief};

/// A view ends when the car moved so far, m …
const VIEW_M: f64 = 2.0;
/// … or turned so far, rad (10°).
const VIEW_TURN: f64 = 0.175;

/// Running sums of a track's evidence on its shape; memory does not grow with its length.
#[derive(Clone, Debug)]
pub(crate) struct ShapeSum {
    before: Mean,
    ended: Told,
    view: View,
}

/// Of a Gaussian: information, and information times mean.
#[derive(Clone, Copy, Debug)]
struct Told {
    information: Matrix6<f64>,
    vector: Shape,
}

impl Told {
    fn nothing() -> Self {
        Self { information: Matrix6::zeros(), vector: Shape::zeros() }
    }

    fn of(belief: &ShapeBelief) -> Self {
        Self { information: belief.information, vector: belief.information * belief.mean }
    }

    fn add(&mut self, other: &Self, weight: f64) {
        self.information += other.information * weight;
        self.vector += other.vector * weight;
    }
}

/// Mean of what looks told.
#[derive(Clone, Copy, Debug)]
struct Mean {
    sum: Told,
    looks: f64,
}

impl Mean {
    fn of_none() -> Self {
        Self { sum: Told::nothing(), looks: 0.0 }
    }

    fn add(&mut self, told: &Told) {
        self.sum.add(told, 1.0);
        self.looks += 1.0;
    }

    fn append(&mut self, other: &Self) {
        self.sum.add(&other.sum, 1.0);
        self.looks += other.looks;
    }

    fn add_to(&self, told: &mut Told) {
        told.add(&self.sum, 1.0 / self.looks.max(1.0));
    }
}

#[derive(Clone, Debug)]
struct View {
    position: Vector2<f64>,
    axis: f64,
    evidence: Mean,
}

impl View {
    fn new(position: Vector2<f64>, axis: f64) -> Self {
        Self { position, axis, evidence: Mean::of_none() }
    }
}

impl ShapeSum {
    pub(crate) fn new(position: Vector2<f64>, axis: f64) -> Self {
        Self { before: Mean::of_none(), ended: Told::nothing(), view: View::new(position, axis) }
    }

    /// Adds a look from where the track's filter says that the car is.
    pub(crate) fn add(&mut self, car: &CarMeasurement, position: Vector2<f64>, axis: f64) {
        let turned = fold_axis(axis - self.view.axis).abs();
        if (position - self.view.position).norm() > VIEW_M || turned > VIEW_TURN {
            self.view.evidence.add_to(&mut self.ended);
            self.view = View::new(position, axis);
        }
        let before = Told::of(&car.shape_before);
        self.before.add(&before);
        let mut evidence = Told::of(&car.shape);
        evidence.add(&before, -1.0);
        // Less than nothing is no evidence; added up it would blow the shape up instead of holding it.
        if (evidence.information + Matrix6::identity() * 1e-6).cholesky().is_some() {
            self.view.evidence.add(&evidence);
        }
    }

    /// Adds all that another track saw of the same car.
    pub(crate) fn append(&mut self, other: Self) {
        self.before.append(&other.before);
        self.view.evidence.add_to(&mut self.ended);
        other.view.evidence.add_to(&mut self.ended);
        self.ended.add(&other.ended, 1.0);
        self.view.evidence = Mean::of_none();
    }

    /// All views together; any car's shape where there were none, or the sums are no information matrix.
    pub(crate) fn fused(&self) -> ShapeBelief {
        let mut sum = self.ended;
        self.before.add_to(&mut sum);
        self.view.evidence.add_to(&mut sum);
        let information = (sum.information + sum.information.transpose()) / 2.0;
        match information.cholesky() {
            Some(factor) => ShapeBelief { mean: factor.solve(&sum.vector), information },
            None => ShapeBelief::default(),
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
            shape_before: ShapeBelief::default(),
            shape: ShapeBelief { mean: Shape::repeat(shape), information: Matrix6::identity() * information },
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
        let ShapeBelief { mean: shape, information } = sum.fused();
        assert!((shape - Shape::repeat(1.5)).norm() < 1e-12 && (information[(0, 0)] - 4.0).abs() < 1e-12);
        // Three metres on: as much evidence again, of (4 · 1.5) / 3 = 2 without the prior.
        sum.add(&look(1.5, 4.0), at + Vector2::new(3.0, 0.0), 0.0);
        let ShapeBelief { mean: shape, information } = sum.fused();
        assert!((shape[0] - 12.0 / 7.0).abs() < 1e-12 && (information[(0, 0)] - 7.0).abs() < 1e-12);
    }

    #[test]
    fn information_below_the_prior_is_left_out() {
        let at = Vector2::new(0.0, 20.0);
        let mut sum = ShapeSum::new(at, 0.0);
        (0..9).for_each(|_| sum.add(&look(3.0, 0.01), at, 0.0));
        assert!(sum.fused().mean.norm() < 1e-12);
    }

    #[test]
    fn a_shape_that_is_held_stays_what_it_is() {
        let held = ShapeBelief { mean: Shape::repeat(1.5), information: Matrix6::identity() * 5.0 };
        let look = CarMeasurement { shape_before: held, shape: held, ..look(0.0, 1.0) };
        let mut sum = ShapeSum::new(Vector2::new(0.0, 20.0), 0.0);
        (0..10).for_each(|i| sum.add(&look, Vector2::new(0.0, 20.0 + 5.0 * f64::from(i)), 0.0));
        let fused = sum.fused();
        assert!((fused.mean - held.mean).norm() < 1e-12);
        assert!((fused.information - held.information).norm() < 1e-12, "held looks are no evidence");
    }

    #[test]
    fn what_is_known_of_all_cars_is_counted_once() {
        // A place's cars are larger, and every look tells a little and finds what was thought beforehand.
        let before = ShapeBelief { mean: Shape::repeat(0.8), ..ShapeBelief::default() };
        let after = ShapeBelief { information: Matrix6::identity() * 1.5, ..before };
        let look = CarMeasurement { shape_before: before, shape: after, ..look(0.0, 1.0) };
        let mut sum = ShapeSum::new(Vector2::new(0.0, 20.0), 0.0);
        (0..10).for_each(|i| sum.add(&look, Vector2::new(0.0, 20.0 + 5.0 * f64::from(i)), 0.0));
        assert!((sum.fused().mean - before.mean).norm() < 1e-12);
        assert!((sum.fused().information[(0, 0)] - 6.0).abs() < 1e-12);
    }
}
