//! Estimates one shape per track.
//!
//! Observations from the same position share their bias, and together count as one view. Views add up, and the prior
//! N(m, Λ⁻¹) is counted once. Each observation contributes the information that it adds to its own prior, N(m_i,
//! Λ_i⁻¹):
//!
//! ```text
//! I = Λ + Σ_views mean(I_i − Λ_i),    I λ = Λ m + Σ_views mean(I_i λ_i − Λ_i m_i)
//! ```
//!
//! Observations may have different priors, for example if a first pass estimated the car in some of them. Then N(m,
//! Λ⁻¹) is the prior with the most information.

use nalgebra::{Matrix6, Vector2};
use roadplane_base::{Shape, fold_axis};

use crate::{CarMeasurement, ShapeEstimate};

/// Distance that the car moves before a new view begins, m.
const VIEW_M: f64 = 2.0;
/// Angle by which a vehicle turns before a new view begins, rad.
const VIEW_TURN: f64 = 0.4;

/// Running sums of a track's evidence on its shape. Their size does not grow with the track's length.
#[derive(Clone, Debug, Default)]
pub(crate) struct ShapeSum {
    /// The prior with the most information so far.
    prior: Option<ShapeEstimate>,
    /// Sum of the views that have ended.
    ended: Canonical,
    /// The view that is still open.
    view: View,
}

/// A Gaussian in canonical form: information matrix, and information times mean.
#[derive(Clone, Copy, Debug, Default)]
struct Canonical {
    information: Matrix6<f64>,
    vector: Shape,
}

impl Canonical {
    /// Converts an estimate to canonical form.
    fn of(estimate: &ShapeEstimate) -> Self {
        Self { information: estimate.information, vector: estimate.information * estimate.mean }
    }

    /// Adds another form, multiplied by a weight.
    fn add(&mut self, other: &Self, weight: f64) {
        self.information += other.information * weight;
        self.vector += other.vector * weight;
    }
}

/// Observations from about one position.
#[derive(Clone, Debug, Default)]
struct View {
    /// Position (x, y) of the car where the view begins, m.
    position: Vector2<f64>,
    /// Axis of the car where the view begins, rad.
    axis: f64,
    /// Sum of the information that the observations add.
    evidence: Canonical,
    /// Number of observations.
    count: f64,
}

impl View {
    /// Adds the mean of the view's observations to a sum.
    fn add_to(&self, sum: &mut Canonical) {
        sum.add(&self.evidence, 1.0 / self.count.max(1.0));
    }
}

impl ShapeSum {
    /// Starts the sums of a track at a position (m) with an axis (rad).
    pub(crate) fn new(position: Vector2<f64>, axis: f64) -> Self {
        Self { view: View { position, axis, ..View::default() }, ..Self::default() }
    }

    /// Adds an observation. `position` (m) and `axis` (rad) are those of the track's filter.
    pub(crate) fn add(&mut self, car: &CarMeasurement, position: Vector2<f64>, axis: f64) {
        self.take_prior(car.shape_before);
        if car.shape == car.shape_before {
            return;
        }
        let turned = fold_axis(axis - self.view.axis).abs();
        if (position - self.view.position).norm() > VIEW_M || turned > VIEW_TURN {
            self.view.add_to(&mut self.ended);
            self.view = View { position, axis, ..View::default() };
        }
        let mut evidence = Canonical::of(&car.shape);
        evidence.add(&Canonical::of(&car.shape_before), -1.0);
        // Negative information is no evidence. Its sum would enlarge the shape instead of stabilising it.
        if (evidence.information + Matrix6::identity() * 1e-6).cholesky().is_some() {
            self.view.evidence.add(&evidence, 1.0);
            self.view.count += 1.0;
        }
    }

    /// Adds all observations that another track has of the same car.
    pub(crate) fn append(&mut self, other: Self) {
        if let Some(prior) = other.prior {
            self.take_prior(prior);
        }
        for view in [other.view, std::mem::take(&mut self.view)] {
            view.add_to(&mut self.ended);
        }
        self.ended.add(&other.ended, 1.0);
    }

    /// Takes this prior if it has more information than the current one.
    fn take_prior(&mut self, prior: ShapeEstimate) {
        let is_less = |own: &ShapeEstimate| own.information.trace() < prior.information.trace();
        if self.prior.as_ref().is_none_or(is_less) {
            self.prior = Some(prior);
        }
    }

    /// Returns the shape from all views together. It is the atlas' mean car if there are no observations, or if the sum
    /// is not positive definite.
    pub(crate) fn fused(&self) -> ShapeEstimate {
        let mut sum = Canonical::of(&self.prior.unwrap_or_default());
        sum.add(&self.ended, 1.0);
        self.view.add_to(&mut sum);
        let information = (sum.information + sum.information.transpose()) / 2.0;
        match information.cholesky() {
            Some(factor) => ShapeEstimate { mean: factor.solve(&sum.vector), information },
            None => ShapeEstimate::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Detection;
    use roadplane_base::{GroundPose, VehicleClass};

    /// Returns a measurement with all shape coefficients equal, and this information in each of them.
    fn measured(shape: f64, information: f64) -> CarMeasurement {
        let pose = GroundPose { x_m: 0.0, y_m: 20.0, heading_rad: 0.0 };
        let seen = Detection::uncut([0.0, 0.0, 10.0, 10.0], 1.0, VehicleClass::Car);
        let shape =
            ShapeEstimate { mean: Shape::repeat(shape), information: Matrix6::identity() * information };
        let measured = CarMeasurement::by_box(pose, nalgebra::Matrix3::identity(), seen);
        CarMeasurement { shape, from_box: false, ..measured }
    }

    #[test]
    fn observations_from_one_place_count_once_and_views_add_up() {
        let at = Vector2::new(0.0, 20.0);
        let mut sum = ShapeSum::new(at, 0.0);
        (0..100).for_each(|_| sum.add(&measured(1.5, 4.0), at, 0.0));
        let ShapeEstimate { mean: shape, information } = sum.fused();
        assert!((shape - Shape::repeat(1.5)).norm() < 1e-12 && (information[(0, 0)] - 4.0).abs() < 1e-12);
        // Three metres on there is as much evidence again: (4 · 1.5) / 3 = 2 without the prior.
        sum.add(&measured(1.5, 4.0), at + Vector2::new(3.0, 0.0), 0.0);
        let ShapeEstimate { mean: shape, information } = sum.fused();
        assert!((shape[0] - 12.0 / 7.0).abs() < 1e-12 && (information[(0, 0)] - 7.0).abs() < 1e-12);
    }

    #[test]
    fn information_below_the_prior_is_left_out() {
        let at = Vector2::new(0.0, 20.0);
        let mut sum = ShapeSum::new(at, 0.0);
        (0..9).for_each(|_| sum.add(&measured(3.0, 0.01), at, 0.0));
        assert!(sum.fused().mean.norm() < 1e-12);
    }

    #[test]
    fn the_prior_of_all_cars_is_counted_once() {
        // The cars of this site are larger, N(0.8, 1). Ten positions give equal evidence of 1.6 each, which one
        // observation alone reduces to 1.2.
        let before = ShapeEstimate { mean: Shape::repeat(0.8), ..ShapeEstimate::default() };
        let after = ShapeEstimate { mean: Shape::repeat(1.2), information: Matrix6::identity() * 2.0 };
        let car = CarMeasurement { shape_before: before, shape: after, ..measured(0.0, 1.0) };
        let mut sum = ShapeSum::new(Vector2::new(0.0, 20.0), 0.0);
        (0..10).for_each(|i| sum.add(&car, Vector2::new(0.0, 20.0 + 5.0 * f64::from(i)), 0.0));
        assert!((sum.fused().mean[0] - (0.8 + 10.0 * 1.6) / 11.0).abs() < 1e-12);
        assert!((sum.fused().information[(0, 0)] - 11.0).abs() < 1e-12);
    }

    #[test]
    fn a_certain_shape_stays_beside_uncertain_observations() {
        let certain = ShapeEstimate { mean: Shape::repeat(1.5), information: Matrix6::identity() * 20.0 };
        let known = CarMeasurement { shape_before: certain, shape: certain, ..measured(0.0, 1.0) };
        let at = Vector2::new(0.0, 20.0);
        let [mut some, mut others] = [ShapeSum::new(at, 0.0), ShapeSum::new(at, 0.0)];
        (0..10).for_each(|_| some.add(&known, at, 0.0));
        (0..90).for_each(|_| others.add(&measured(0.5, 2.0), at, 0.0));
        for [mut first, second] in [[some.clone(), others.clone()], [others, some]] {
            first.append(second);
            // One view adds evidence of weight 1 for the value 1.
            assert!((first.fused().mean[0] - (20.0 * 1.5 + 1.0) / 21.0).abs() < 1e-12);
        }
    }
}
