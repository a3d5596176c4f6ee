//! The body type of a car (sedan, van, …), which narrows the prior on its shape.
//!
//! A car's size depends mainly on its body type. Heights of all cars differ by 11 %, and heights of sedans by 3 %. So
//! the distribution of a car's shape s is a mixture. A fraction share_k of all cars has the body type k, and the shapes
//! of this type have the normal distribution N(μ_k, Σ_k). Let ŝ be the shape that fits a car's keypoints best, for the
//! current camera, and A the information of the keypoints on s. The car then has type k with the probability
//!
//! ```text
//! p_k ∝ share_k ∫ exp(−½ (s − ŝ)ᵀ A (s − ŝ)) N(s; μ_k, Σ_k) ds
//! ```
//!
//! The car's new shape prior is one normal distribution. Its mean and covariance are those of the mixture with the
//! weights p_k. It is narrow if one type is almost certain, and wider otherwise.
//!
//! With all modes, one more type is a vehicle of unknown size, and the shares above are those of the remaining cars. A car
//! on a car transporter or on a parking deck is nearer than a car on the ground, so it appears larger. The front of a
//! lorry may look like a large car. The size of such a vehicle must not count as evidence on the height of the camera.

use nalgebra::{Cholesky, Const, SMatrix, SVector, Vector3};
use roadplane_base::{ALL_MODES, BodyType, MODES, ShapeAtlas};

use crate::options::SceneOptions;

/// Number of rounds. In each round, body types of all cars are inferred, and the cost is minimised with the new priors.
pub(crate) const ROUNDS_OF_TYPES: usize = 2;
/// Share of vehicles of unknown size. From 0.02 to 0.1, the cameras of 25 sites are equally good.
const UNKNOWN_SIZE_SHARE: f64 = 0.05;
/// Sd of the log size of a vehicle of unknown size, beside that of all cars. A car that is carried 2.5 m high appears
/// larger by 0.33, for a camera at 9 m. With 0.2 or 0.3, the cameras of 25 sites are equally good.
const UNKNOWN_SIZE_SD: f64 = 0.25;

/// A Gaussian prior on the coefficients of the first N modes.
#[derive(Clone, Debug)]
pub(crate) struct Gaussian<const N: usize> {
    pub mean: SVector<f64, N>,
    pub information: SMatrix<f64, N, N>,
}

impl<const N: usize> Gaussian<N> {
    /// Returns the cost ½ (s − mean)ᵀ information (s − mean).
    pub fn cost(&self, shape: &SVector<f64, N>) -> f64 {
        0.5 * (shape - self.mean).dot(&self.gradient(shape))
    }

    /// Returns the gradient of the cost with respect to the shape.
    pub fn gradient(&self, shape: &SVector<f64, N>) -> SVector<f64, N> {
        self.information * (shape - self.mean)
    }
}

impl Gaussian<MODES> {
    /// Returns the prior of the whole car population: N(0, I).
    pub fn of_all_cars() -> Self {
        Self { mean: SVector::zeros(), information: SMatrix::identity() }
    }
}

impl Gaussian<ALL_MODES> {
    /// Returns a prior on all modes from the prior `coarse` on the first modes.
    ///
    /// Each coefficient of the fine modes gets the prior N(0, 1 / `fine_information`).
    pub fn of_all_modes(coarse: &Gaussian<MODES>, fine_information: f64) -> Self {
        let mut mean = SVector::<f64, ALL_MODES>::zeros();
        mean.fixed_rows_mut::<MODES>(0).copy_from(&coarse.mean);
        let mut information = SMatrix::<f64, ALL_MODES, ALL_MODES>::identity() * fine_information;
        information.fixed_view_mut::<MODES, MODES>(0, 0).copy_from(&coarse.information);
        Self { mean, information }
    }
}

/// One body type of the mixture.
struct Component<const N: usize> {
    gaussian: Gaussian<N>,
    covariance: SMatrix<f64, N, N>,
    /// Product of the inverse covariance and the mean.
    vector: SVector<f64, N>,
    /// Part of the type's log probability that does not depend on the observed car.
    ///
    /// It is log share − ½ log det Σ − ½ μᵀ Σ⁻¹ μ, for the type's share, mean μ and covariance Σ.
    log_weight: f64,
}

impl<const N: usize> Component<N> {
    /// Creates the type of this share; `None` if the covariance is not positive definite.
    fn new(share: f64, mean: SVector<f64, N>, covariance: SMatrix<f64, N, N>) -> Option<Self> {
        let factor = covariance.cholesky()?;
        let gaussian = Gaussian { mean, information: factor.inverse() };
        let vector = gaussian.information * mean;
        let log_weight = share.ln() - half_log_determinant(&factor) - 0.5 * mean.dot(&vector);
        Some(Self { gaussian, covariance, vector, log_weight })
    }
}

/// The mixture of all body types, as distributions of the first N shape coefficients.
pub(crate) struct BodyTypes<const N: usize>(Vec<Component<N>>);

impl<const N: usize> BodyTypes<N> {
    /// Creates the mixture from the atlas; it is empty if body types are switched off, or if the atlas has none.
    ///
    /// The fine coefficients are multiplied by the options' `atlas_residual_scale`.
    pub fn new(atlas: &ShapeAtlas, options: &SceneOptions) -> Self {
        if !options.steps.body_types || atlas.body_types.is_empty() {
            return Self(Vec::new());
        }
        let fine = options.atlas_residual_scale;
        let sd = SVector::<f64, N>::from_fn(|j, _| if j < MODES { 1.0 } else { fine });
        let of_unknown_size = || {
            let by_size = by_log_size::<N>(atlas)? * UNKNOWN_SIZE_SD;
            let covariance = SMatrix::from_diagonal(&sd.component_mul(&sd)) + by_size * by_size.transpose();
            Component::new(UNKNOWN_SIZE_SHARE, SVector::zeros(), covariance)
        };
        // The first modes alone cannot change the size of a car without its form.
        let unknown = if N == ALL_MODES { of_unknown_size() } else { None };
        let sized_share = if unknown.is_some() { 1.0 - UNKNOWN_SIZE_SHARE } else { 1.0 };
        let of_type = |body: &BodyType| {
            let covariance = SMatrix::<f64, N, N>::from_fn(|i, j| sd[i] * sd[j] * body.covariance[(i, j)]);
            let mean = SVector::<f64, N>::from_fn(|j, _| sd[j] * body.mean[j]);
            Component::new(sized_share * body.share, mean, covariance)
        };
        Self(atlas.body_types.iter().filter_map(of_type).chain(unknown).collect())
    }

    /// Replaces `prior` by the prior of a car's likely body types. If the mixture is empty, `prior` does not change.
    ///
    /// `information` and `gradient` are the Hessian and gradient of the keypoints' cost at `shape`.
    pub fn update_prior(
        &self,
        prior: &mut Gaussian<N>,
        shape: &SVector<f64, N>,
        information: &SMatrix<f64, N, N>,
        gradient: &SVector<f64, N>,
    ) {
        if let Some(updated) = self.prior_of(information, &(information * shape - gradient)) {
            *prior = updated;
        }
    }

    /// Returns the shape prior of a car's likely body types; `None` if the mixture is empty.
    ///
    /// `information` is the keypoints' information A on the shape, and `vector` is A ŝ with the best-fitting shape ŝ.
    fn prior_of(&self, information: &SMatrix<f64, N, N>, vector: &SVector<f64, N>) -> Option<Gaussian<N>> {
        let odds = self.odds(information, vector)?;
        let types = || self.0.iter().zip(&odds);
        let mean: SVector<f64, N> = types().map(|(component, p)| component.gaussian.mean * *p).sum();
        let spread = |(component, p): (&Component<N>, &f64)| {
            let off = component.gaussian.mean - mean;
            (component.covariance + off * off.transpose()) * *p
        };
        let covariance: SMatrix<f64, N, N> = types().map(spread).sum();
        Some(Gaussian { mean, information: covariance.cholesky()?.inverse() })
    }

    /// Returns the probability of each body type for one car.
    ///
    /// `information` is the keypoints' information A on the shape, and `vector` is A ŝ with the best-fitting shape ŝ.
    fn odds(&self, information: &SMatrix<f64, N, N>, vector: &SVector<f64, N>) -> Option<Vec<f64>> {
        let evidence = |component: &Component<N>| {
            let factor = (information + component.gaussian.information).cholesky()?;
            let vector = vector + component.vector;
            let squared = vector.dot(&factor.solve(&vector));
            Some(component.log_weight - half_log_determinant(&factor) + 0.5 * squared)
        };
        let evidence: Vec<f64> = self.0.iter().map(evidence).collect::<Option<_>>()?;
        let best = evidence.iter().copied().reduce(f64::max).filter(|best| best.is_finite())?;
        let odds: Vec<f64> = evidence.iter().map(|evidence| (evidence - best).exp()).collect();
        let total: f64 = odds.iter().sum();
        Some(odds.into_iter().map(|odds| odds / total).collect())
    }
}

/// Returns the change of the first N shape coefficients with the log of a car's size, by least squares.
fn by_log_size<const N: usize>(atlas: &ShapeAtlas) -> Option<SVector<f64, N>> {
    let modes: Vec<_> = atlas.modes.iter().chain(&atlas.fine_modes).take(N).collect();
    let product =
        |a: &[Vector3<f64>], b: &[Vector3<f64>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
    let normal = SMatrix::<f64, N, N>::from_fn(|i, j| product(modes[i], modes[j]));
    let right = SVector::<f64, N>::from_fn(|i, _| product(modes[i], &atlas.mean));
    Some(normal.cholesky()?.solve(&right))
}

fn half_log_determinant<const N: usize>(factor: &Cholesky<f64, Const<N>>) -> f64 {
    factor.l_dirty().diagonal().map(f64::ln).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::FullShape;
    use roadplane_synth::{Rng, draw_shape};

    type FullMatrix = SMatrix<f64, ALL_MODES, ALL_MODES>;

    fn types() -> (ShapeAtlas, BodyTypes<ALL_MODES>) {
        let atlas = ShapeAtlas::shipped().unwrap();
        let types = BodyTypes::new(&atlas, &SceneOptions::default());
        assert_eq!(types.0.len(), atlas.body_types.len() + 1);
        (atlas, types)
    }

    #[test]
    fn the_prior_is_all_traffic_or_one_type() {
        let (atlas, types) = types();
        let prior = types.prior_of(&FullMatrix::zeros(), &FullShape::zeros()).unwrap();
        // Over all traffic, the coefficients of the modes have mean 0 and covariance 1, apart from unknown sizes.
        assert!(prior.mean.amax() < 0.1, "{}", prior.mean);
        let by_size = by_log_size::<ALL_MODES>(&atlas).unwrap() * UNKNOWN_SIZE_SD;
        let covariance =
            prior.information.try_inverse().unwrap() - by_size * by_size.transpose() * UNKNOWN_SIZE_SHARE;
        assert!(covariance.diagonal().iter().all(|variance| (0.7..1.3).contains(variance)), "{covariance}");
        for body in &atlas.body_types {
            let information = FullMatrix::identity() * 1e4;
            let prior = types.prior_of(&information, &(information * body.mean)).unwrap();
            assert!((prior.mean - body.mean).amax() < 0.1, "{}: {}", body.name, prior.mean);
        }
    }

    #[test]
    fn a_car_that_is_too_large_has_an_unknown_size() {
        let (atlas, types) = types();
        let by_size = by_log_size::<ALL_MODES>(&atlas).unwrap();
        let information = FullMatrix::identity() * 100.0;
        let sedan = atlas.body_types.iter().find(|body| body.name == "sedan").unwrap().mean;
        let unknown = |log_size: f64| {
            let shape = sedan + by_size * log_size;
            let odds = types.odds(&information, &(information * shape)).unwrap();
            (odds[atlas.body_types.len()], types.prior_of(&information, &(information * shape)).unwrap())
        };
        let none = ShapeAtlas { body_types: Vec::new(), ..atlas.clone() };
        assert!(BodyTypes::<ALL_MODES>::new(&none, &SceneOptions::default()).0.is_empty());
        let (ordinary, large, small) = (unknown(0.0), unknown(0.3), unknown(-0.3));
        assert!(
            ordinary.0 < 0.02 && large.0 > 0.9 && small.0 > 0.9,
            "{} {} {}",
            ordinary.0,
            large.0,
            small.0
        );
        // The prior of such a car says little on its size.
        let size_sd = |prior: &Gaussian<ALL_MODES>| {
            let information = by_size.dot(&(prior.information * by_size));
            information.sqrt().recip()
        };
        assert!(size_sd(&ordinary.1) < 0.05 && size_sd(&large.1) > 0.15, "{}", size_sd(&large.1));
    }

    #[test]
    fn probabilities_of_types_are_calibrated() {
        let (atlas, types) = types();
        let mut rng = Rng::new(3);
        // Half of the coefficients are measured with an sd of 1, and the other half with an sd of 10.
        let information =
            FullMatrix::from_diagonal(&FullShape::from_fn(|j, _| if j % 2 == 0 { 1.0 } else { 0.01 }));
        let (mut predicted, mut observed, mut of_truth) = (0.0, 0.0, 0.0);
        let cars = 4000;
        for _ in 0..cars {
            let number = (rng.unit() * atlas.body_types.len() as f64) as usize;
            let body = &atlas.body_types[number];
            let of_type = ShapeAtlas { body_types: vec![body.clone()], ..atlas.clone() };
            let shape = draw_shape(&of_type, &mut rng);
            let measured = shape + FullShape::from_fn(|j, _| rng.normal() / information[(j, j)].sqrt());
            let mut odds = types.odds(&information, &(information * measured)).unwrap();
            // No car of this loop has an unknown size.
            let sized = 1.0 - odds.pop().unwrap();
            odds.iter_mut().for_each(|odds| *odds /= sized);
            // All types are equally frequent in this loop, so each car is weighted by the true share of its type.
            predicted += body.share * odds[0];
            observed += body.share * f64::from(u8::from(number == 0));
            of_truth += odds[number] / f64::from(cars);
        }
        // Without any measurement, the mean probability of the true type would be 1/8.
        assert!(of_truth > 0.3, "{of_truth}");
        assert!((predicted / observed - 1.0).abs() < 0.1, "{predicted} {observed}");
    }
}
