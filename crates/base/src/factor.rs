//! Factors on the camera that do not come from cars: parameters given by the user, lengths on the ground, and lines of
//! the scene.
//!
//! A factor is a cost as a function of the camera parameters (log focal, tilt, roll, log height). The cost is the
//! negative log likelihood of a measurement. Every estimate of a camera adds the costs of its factors to the cost of
//! the cars. Pixels are undistorted and relative to the principal point.

use nalgebra::{Matrix2, Matrix4, SMatrix, Vector2, Vector3, Vector4};

use crate::{Camera, CameraParams};

/// A factor on the camera: one measurement, which adds a term to the cost of an estimate.
///
/// Pixels are undistorted and relative to the principal point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Factor {
    /// A measurement of one camera parameter: log focal (px), tilt (rad), roll (rad) or log height (m).
    Number {
        /// Index of the parameter in [`CameraParams::to_vector`].
        which: usize,
        /// Measured value, in the parameter's unit.
        value: f64,
        /// Sd of the value, above 0.
        sd: f64,
    },
    /// An estimate of all four camera parameters from another source, such as a survey.
    Camera {
        /// Mean of (log focal, tilt, roll, log height).
        mean: Vector4<f64>,
        /// Inverse covariance of the estimate. It may be singular.
        information: Matrix4<f64>,
        /// Whether the height was estimated from cars of the same scene.
        ///
        /// If true, the covariance does not include the uncertainty of the mean size of these cars.
        by_cars: bool,
    },
    /// A known distance between two pixels on the ground.
    Length {
        /// Both ends, px.
        ends_px: [Vector2<f64>; 2],
        /// Sd of each coordinate of the ends, px.
        end_sd_px: f64,
        /// Length, m, above 0.
        length_m: f64,
        /// Sd of the length, as a share of the length.
        log_sd: f64,
    },
    /// The vanishing point of the scene's vertical lines, such as masts and edges of houses.
    ///
    /// At the pixel p, a vertical line has the image direction `(sin roll, −cos roll) + inverse_distance · p`. The road
    /// need not be level. The angle between its normal and the vertical has the sd [`Factor::SLOPE_SD`]. For steep
    /// roads, whose share is [`Factor::STEEP_SHARE`], the sd is [`Factor::STEEP_SD`].
    VerticalVanishingPoint {
        /// One over the distance between the vanishing point and the principal point, 1/px: tan(tilt) / focal length.
        inverse_distance: f64,
        /// Clockwise turn of the horizon in the image, rad.
        roll: f64,
        /// Covariance of (`inverse_distance`, `roll`).
        covariance: Matrix2<f64>,
    },
}

/// Gradient and approximate Hessian of the cost of factors, for one Gauss–Newton step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FactorTerms {
    /// Gradient of the cost with respect to (log focal, tilt, roll, log height).
    pub gradient: Vector4<f64>,
    /// Gauss–Newton approximation of the Hessian.
    pub information: Matrix4<f64>,
}

/// Step of central differences: rad for angles, and without unit for logarithms.
const STEP: f64 = 1e-5;
/// Cost of a factor that cannot be evaluated for a camera, for example if its pixels lie above the camera's horizon.
const IMPOSSIBLE: f64 = 1e3;

/// One Gaussian component of a factor whose error distribution is a mixture.
///
/// The residual of the component has the distribution N(0, covariance).
#[derive(Clone, Copy, Debug)]
pub struct FactorComponent {
    /// Prior probability of the component, 0–1.
    pub share: f64,
    /// Measured value minus the value that the camera predicts, in the factor's units.
    pub residual: Vector2<f64>,
    /// Covariance of the residual.
    pub covariance: Matrix2<f64>,
}

impl FactorComponent {
    /// Returns the density of the residual times `share`, up to a constant factor, and the inverse covariance of the
    /// residual.
    ///
    /// Returns `None` if the covariance is singular.
    #[must_use]
    pub fn density(&self) -> Option<(f64, Matrix2<f64>)> {
        let information = self.covariance.try_inverse()?;
        let distance = self.residual.dot(&(information * self.residual));
        Some((self.share * (-0.5 * distance).exp() / self.covariance.determinant().sqrt(), information))
    }
}

/// Residual and cost of a factor for given camera parameters.
struct Misfit {
    /// Residual, in sds or in the factor's units. The second entry is 0 for a factor with one residual.
    residual: Vector2<f64>,
    /// Inverse covariance of the residual.
    weight: Matrix2<f64>,
    cost: f64,
}

impl Misfit {
    /// Creates the misfit of a factor with one residual, which is in units of its sd.
    fn of_one(residual: f64, cost: f64) -> Self {
        Self { residual: Vector2::new(residual, 0.0), weight: Matrix2::new(1.0, 0.0, 0.0, 0.0), cost }
    }
}

impl Factor {
    /// Sd of the slope of roads and parking lots, along and across the road, rad.
    ///
    /// The three numbers on slopes were chosen on calibrated real cameras and confirmed on rendered ones
    /// (`docs/book/science.md`, "Vertical lines").
    pub const SLOPE_SD: f64 = 0.0175;
    /// Sd of the slope of steep streets, along and across the road, rad.
    pub const STEEP_SD: f64 = 0.087;
    /// Share of steep streets, 0–1.
    pub const STEEP_SHARE: f64 = 0.3;

    /// Returns the negative log likelihood of a camera, up to a constant.
    #[must_use]
    pub fn cost(&self, camera: &Vector4<f64>) -> f64 {
        self.misfit(camera).map_or(IMPOSSIBLE, |misfit| misfit.cost)
    }

    /// Returns the factor without its information on scale, or `None` if it contains no other information.
    ///
    /// The result is for problems in which the car sizes of the atlas give the scale. Lengths and heights in metres are
    /// removed.
    #[must_use]
    pub fn without_scale(&self) -> Option<Self> {
        match *self {
            Self::Number { which: 3, .. } | Self::Length { .. } => None,
            Self::Camera { mean, mut information, by_cars: false } => {
                let (of_height, column) = (information[(3, 3)], information.column(3).into_owned());
                if of_height > 0.0 {
                    information -= column * column.transpose() / of_height;
                }
                information.row_mut(3).fill(0.0);
                information.column_mut(3).fill(0.0);
                Some(Self::Camera { mean, information, by_cars: false })
            }
            factor => Some(factor),
        }
    }

    /// Whether the factor's scale comes from the sizes of cars, not from measured metres.
    #[must_use]
    pub fn is_by_cars(&self) -> bool {
        matches!(self, Self::Camera { by_cars: true, .. })
    }

    /// Returns the residual in units of its sd. The sign convention depends on the kind of factor.
    ///
    /// Returns `None` if the factor cannot be evaluated at this camera.
    #[must_use]
    pub fn residual(&self, camera: &Vector4<f64>) -> Option<f64> {
        let Misfit { residual, weight, .. } = self.misfit(camera)?;
        let size = residual.dot(&(weight * residual)).max(0.0).sqrt();
        Some(size.copysign(residual.x))
    }

    /// Returns the length that this camera measures between the two pixels, m, and a relative sd.
    ///
    /// The sd combines the errors of the given length and of the pixels. Returns `None` for other kinds of factors, and
    /// if a pixel lies above the horizon.
    #[must_use]
    pub fn length(&self, camera: &Vector4<f64>) -> Option<(f64, f64)> {
        let Self::Length { ends_px, end_sd_px, log_sd, .. } = self else { return None };
        let params = CameraParams::from_vector(camera);
        let [a, b] = [ground(&params, &ends_px[0])?, ground(&params, &ends_px[1])?];
        let length = (a - b).norm();
        let mut variance = log_sd * log_sd;
        for (end, (other, here)) in ends_px.iter().zip([(b, a), (a, b)]) {
            for axis in [Vector2::x(), Vector2::y()] {
                let moved = ground(&params, &(end + axis))?;
                let change = (moved - here).dot(&(here - other)) / (length * length);
                variance += (change * end_sd_px).powi(2);
            }
        }
        Some((length, variance.sqrt()))
    }

    fn misfit(&self, camera: &Vector4<f64>) -> Option<Misfit> {
        match *self {
            Self::Number { which, value, sd } => {
                let residual = (camera.get(which)? - value) / sd;
                Some(Misfit::of_one(residual, 0.5 * residual * residual))
            }
            Self::Camera { mean, information, .. } => {
                let off = camera - mean;
                let square = off.dot(&(information * off)).max(0.0);
                Some(Misfit::of_one(square.sqrt(), 0.5 * square))
            }
            Self::Length { length_m, .. } => {
                let (length, log_sd) = self.length(camera)?;
                let residual = (length / length_m).ln() / log_sd;
                let cost = 0.5 * residual * residual + log_sd.ln();
                cost.is_finite().then(|| Misfit::of_one(residual, cost))
            }
            Self::VerticalVanishingPoint { .. } => {
                let [level, steep] = self.components(camera)?;
                let (of_level, of_steep) = (level.density()?, steep.density()?);
                let total = of_level.0 + of_steep.0;
                let weight = (of_level.0 * of_level.1 + of_steep.0 * of_steep.1) / total;
                let cost = -total.ln();
                cost.is_finite().then_some(Misfit { residual: level.residual, weight, cost })
            }
        }
    }

    /// Returns the two components of a vertical vanishing point: one for a nearly level street, and one for a steep
    /// street.
    ///
    /// Returns `None` for other kinds of factors, which have one component. Where several estimates are combined,
    /// expectation propagation handles the two components.
    #[must_use]
    pub fn components(&self, camera: &Vector4<f64>) -> Option<[FactorComponent; 2]> {
        let Self::VerticalVanishingPoint { inverse_distance, roll, covariance } = *self else { return None };
        let params = CameraParams::from_vector(camera);
        let (tan, cos) = (params.tilt.tan(), params.tilt.cos());
        let residual = Vector2::new(inverse_distance - tan / params.focal_px(), roll - params.roll);
        let sloped = |slope_sd: f64, share: f64| {
            let of_slope = Vector2::new(1.0 / (cos * cos * params.focal_px()), 1.0 / cos) * slope_sd;
            let covariance = covariance + Matrix2::from_diagonal(&of_slope.component_mul(&of_slope));
            FactorComponent { share, residual, covariance }
        };
        let steep = Self::STEEP_SHARE;
        Some([sloped(Self::SLOPE_SD, 1.0 - steep), sloped(Self::STEEP_SD, steep)])
    }

    /// Returns the derivative of the residual with respect to (log focal, tilt, roll, log height).
    ///
    /// The derivative is 0 if the factor cannot be evaluated.
    #[must_use]
    pub fn residual_by_camera(&self, camera: &Vector4<f64>) -> SMatrix<f64, 2, 4> {
        self.derivatives(camera).1
    }

    /// Returns the derivatives of the cost and of the residual with respect to the camera parameters (central
    /// differences).
    fn derivatives(&self, camera: &Vector4<f64>) -> (Vector4<f64>, SMatrix<f64, 2, 4>) {
        let (mut gradient, mut by) = (Vector4::zeros(), SMatrix::<f64, 2, 4>::zeros());
        for i in 0..4 {
            let step = Vector4::ith(i, STEP);
            if let (Some(plus), Some(minus)) = (self.misfit(&(camera + step)), self.misfit(&(camera - step)))
            {
                gradient[i] = (plus.cost - minus.cost) / (2.0 * STEP);
                by.set_column(i, &((plus.residual - minus.residual) / (2.0 * STEP)));
            }
        }
        (gradient, by)
    }

    /// Returns the gradient and the approximate Hessian of the cost for given camera parameters.
    #[must_use]
    pub fn terms(&self, camera: &Vector4<f64>) -> FactorTerms {
        if let Self::Camera { mean, information, .. } = self {
            return FactorTerms { gradient: information * (camera - mean), information: *information };
        }
        let Some(here) = self.misfit(camera) else {
            return FactorTerms { gradient: Vector4::zeros(), information: Matrix4::zeros() };
        };
        let (gradient, by) = self.derivatives(camera);
        FactorTerms { gradient, information: by.transpose() * here.weight * by }
    }
}

impl FactorTerms {
    /// Returns the summed terms of several factors for given camera parameters.
    #[must_use]
    pub fn of<'a>(factors: impl IntoIterator<Item = &'a Factor>, camera: &Vector4<f64>) -> Self {
        let mut sum = Self { gradient: Vector4::zeros(), information: Matrix4::zeros() };
        for factor in factors {
            let terms = factor.terms(camera);
            sum.gradient += terms.gradient;
            sum.information += terms.information;
        }
        sum
    }
}

/// Returns the point at which the viewing ray of a pixel meets the ground, in the camera frame, m.
///
/// Returns `None` if the pixel lies at or above the horizon.
fn ground(params: &CameraParams, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
    let plane = params.plane();
    let camera = Camera::pinhole(params.focal_px(), Vector2::zeros());
    let ray = camera.ray_from_pixel(pixel);
    let falling = -plane.normal_in_camera.dot(&ray);
    (falling > 1e-6).then(|| ray * (plane.height_m / falling))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Vector4<f64> {
        Vector4::new(1200f64.ln(), 0.3, 0.05, 8f64.ln())
    }

    fn factors() -> Vec<Factor> {
        let params = CameraParams::from_vector(&camera());
        let project = |x: f64, y: f64, z: f64| {
            let point = params.plane().camera_from_world() * nalgebra::Point3::new(x, y, z);
            1200.0 * point.coords.xy() / point.z
        };
        let length = |a: Vector2<f64>, b: Vector2<f64>| Factor::Length {
            ends_px: [a, b],
            end_sd_px: 0.5,
            length_m: 5.0,
            log_sd: 0.01,
        };
        vec![
            Factor::Number { which: 1, value: 0.3, sd: 0.01 },
            Factor::Camera { mean: camera(), information: correlated(), by_cars: false },
            length(project(-2.0, 18.0, 0.0), project(3.0, 18.0, 0.0)),
            length(project(0.0, 15.0, 0.0), project(3.0, 19.0, 0.0)),
            Factor::VerticalVanishingPoint {
                inverse_distance: 0.3f64.tan() / 1200.0,
                roll: 0.05,
                covariance: Matrix2::new(1e-10, 1e-8, 1e-8, 1e-5),
            },
        ]
    }

    fn correlated() -> Matrix4<f64> {
        Matrix4::from_fn(|r, c| if r == c { 900.0 } else { 200.0 })
    }

    #[test]
    fn a_camera_without_scale_keeps_its_other_information() {
        let factor = Factor::Camera { mean: camera(), information: correlated(), by_cars: false };
        let Some(Factor::Camera { information, .. }) = factor.without_scale() else { panic!("{factor:?}") };
        assert!(information.row(3).norm() + information.column(3).norm() < 1e-12);
        let marginal = correlated().try_inverse().unwrap().fixed_view::<3, 3>(0, 0).try_inverse().unwrap();
        assert!((information.fixed_view::<3, 3>(0, 0) - marginal).norm() < 1e-9);
        assert!(factors().iter().filter_map(Factor::without_scale).count() == 3);
    }

    #[test]
    fn a_true_factor_fits_the_true_camera_and_no_other() {
        for factor in factors() {
            assert!(factor.residual(&camera()).unwrap().abs() < 1e-3, "{factor:?}");
            let tilted = camera() + Vector4::new(0.02, 0.1, 0.0, 0.0);
            assert!(factor.residual(&tilted).unwrap().abs() > 0.3, "{factor:?}");
        }
    }

    #[test]
    fn the_gradient_is_that_of_the_cost() {
        let at = camera() + Vector4::new(0.01, -0.008, 0.004, 0.02);
        for factor in factors() {
            let step = Vector4::new(3e-4, 2e-4, -1e-4, 2e-4);
            let change = factor.cost(&(at + step)) - factor.cost(&(at - step));
            let expected = 2.0 * factor.terms(&at).gradient.dot(&step);
            assert!(
                (change - expected).abs() < 1e-3 * expected.abs() + 1e-9,
                "{factor:?}: {change} {expected}"
            );
        }
    }

    #[test]
    fn masts_point_to_the_vertical_vanishing_point() {
        let params = CameraParams::from_vector(&camera());
        let project = |x: f64, y: f64, z: f64| {
            let point = params.plane().camera_from_world() * nalgebra::Point3::new(x, y, z);
            1200.0 * point.coords.xy() / point.z
        };
        let (inverse_distance, roll) = (params.tilt.tan() / params.focal_px(), params.roll);
        for (x, y) in [(3.0, 20.0), (-9.0, 40.0), (0.5, 15.0)] {
            let [foot, top] = [project(x, y, 0.0), project(x, y, 4.0)];
            let along = Vector2::new(roll.sin(), -roll.cos()) + inverse_distance * foot;
            let mast = top - foot;
            assert!(along.perp(&mast).abs() < 1e-9 * along.norm() * mast.norm());
        }
    }

    #[test]
    fn a_vanishing_point_as_of_a_steep_street_pulls_little() {
        let factor_at = |tilt: f64| Factor::VerticalVanishingPoint {
            inverse_distance: tilt.tan() / 1200.0,
            roll: 0.05,
            covariance: Matrix2::new(1e-12, 0.0, 0.0, 1e-6),
        };
        let [level, steep] = [0.31, 0.45].map(|tilt| factor_at(tilt).terms(&camera()).information[(1, 1)]);
        assert!(steep < 0.1 * level, "{steep} {level}");
    }

    #[test]
    fn pixels_in_the_sky_have_no_length() {
        let sky = Factor::Length {
            ends_px: [Vector2::new(0.0, -900.0), Vector2::new(50.0, -900.0)],
            end_sd_px: 1.0,
            length_m: 5.0,
            log_sd: 0.01,
        };
        assert!(sky.residual(&camera()).is_none() && sky.terms(&camera()).gradient == Vector4::zeros());
    }
}
