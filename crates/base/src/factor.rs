//! What something other than cars says of a camera: numbers that the user knows, lengths on the ground, lines of the scene.
//!
//! Each factor is a cost of (log f, tilt, roll, log h), minus its log likelihood, that every solve and every join of solves adds
//! to what the cars say. Pixels are relative to the principal point, without distortion.

use nalgebra::{Matrix2, Matrix4, SMatrix, Vector2, Vector3, Vector4};

use crate::{Camera, CameraParams};

/// A factor on the camera. Pixels: relative to the principal point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Factor {
    /// One of (log focal in px, tilt in rad, roll in rad, log height in m) is about this.
    Number {
        /// Place of the number in [`CameraParams::to_vector`].
        which: usize,
        /// Its value.
        value: f64,
        /// Its sd, above 0.
        sd: f64,
    },
    /// One over the focal length, as rays to cars that are parallel tell it.
    InverseFocal {
        /// Its value, 1/px.
        per_px: f64,
        /// Its sd, above 0.
        sd: f64,
    },
    /// All four numbers, as a survey or another solve has them.
    Camera {
        /// They.
        mean: Vector4<f64>,
        /// Inverse of their covariance; may be singular.
        information: Matrix4<f64>,
        /// The height follows from cars of the same place, and what is not known of these cars' size is not in its sd.
        by_cars: bool,
    },
    /// Two pixels on the ground are this far apart.
    Length {
        /// The pixels.
        ends_px: [Vector2<f64>; 2],
        /// sd of each of their coordinates, px.
        end_sd_px: f64,
        /// The length, m, above 0.
        length_m: f64,
        /// Its sd as a share of it.
        log_sd: f64,
    },
    /// Where the vertical of the scene points, by its masts and house edges. Vertical lines run in the picture along
    /// `(sin roll, −cos roll) + bend · p` at the pixel p. The road need not be level: up of the lines is up of the cars' plane but
    /// for [`Factor::SLOPE_SD`], now and then [`Factor::STEEP_SD`].
    Upright {
        /// tan(tilt) / focal, 1/px: how fast verticals turn across the picture.
        bend: f64,
        /// Clockwise turn of the horizon, rad.
        roll: f64,
        /// Covariance of (bend, roll).
        covariance: Matrix2<f64>,
    },
}

/// What factors add to a cost at a camera, and to the normal equations of a step from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FactorTerms {
    /// Its gradient.
    pub gradient: Vector4<f64>,
    /// Gauss–Newton's approximation of its Hessian.
    pub information: Matrix4<f64>,
}

/// Step of central differences, in log units and rad.
const STEP: f64 = 1e-5;
/// Cost of a factor that makes no sense before a camera (ground pixels above its horizon).
const IMPOSSIBLE: f64 = 1e3;

/// One of the things that a factor may mean: that its residual is N(0, covariance).
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Prior probability, 0–1.
    pub share: f64,
    /// What the factor says less what the camera does, the factor's units.
    pub residual: Vector2<f64>,
    /// Its covariance.
    pub covariance: Matrix2<f64>,
}

impl Reading {
    /// Density of the residual times the share, up to a constant, and the information on it; `None` of a covariance that is none.
    #[must_use]
    pub fn density(&self) -> Option<(f64, Matrix2<f64>)> {
        let information = self.covariance.try_inverse()?;
        let distance = self.residual.dot(&(information * self.residual));
        Some((self.share * (-0.5 * distance).exp() / self.covariance.determinant().sqrt(), information))
    }
}

/// How far off a factor is.
struct Misfit {
    /// In the factor's own units; the second is 0 for factors of one number.
    residual: Vector2<f64>,
    /// Information on it.
    weight: Matrix2<f64>,
    cost: f64,
}

impl Misfit {
    /// Of a factor of one number, its residual in sds.
    fn of_one(residual: f64, cost: f64) -> Self {
        Self { residual: Vector2::new(residual, 0.0), weight: Matrix2::new(1.0, 0.0, 0.0, 0.0), cost }
    }
}

impl Factor {
    /// Slope and crossfall of roads and lots, rad (sd): 1–2.5 % of crossfall and a grade of up to 5 % are what streets are built with
    /// (estimate; of calibrated cameras 1.2 to 2.5° are about equally likely, 1° is less so by a factor of 150).
    pub const SLOPE_SD: f64 = 0.026;
    /// The same of steep streets, rad, …
    pub const STEEP_SD: f64 = 0.087;
    /// … and how many there are of them, 0–1 (estimates).
    pub const STEEP_SHARE: f64 = 0.1;

    /// Minus log likelihood before this camera, up to a constant.
    #[must_use]
    pub fn cost(&self, camera: &Vector4<f64>) -> f64 {
        self.misfit(camera).map_or(IMPOSSIBLE, |misfit| misfit.cost)
    }

    /// What it says before cars of the atlas' sizes, which tell scale by themselves: nothing of lengths and heights that are the
    /// world's. `None` where nothing is left.
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

    /// Whether its scale is that of the cars, not the world's.
    #[must_use]
    pub fn is_by_cars(&self) -> bool {
        matches!(self, Self::Camera { by_cars: true, .. })
    }

    /// How far off it is, in sds, with the sign of what the factor says less what the camera does; `None` where it makes no sense
    /// before this camera.
    #[must_use]
    pub fn residual(&self, camera: &Vector4<f64>) -> Option<f64> {
        let Misfit { residual, weight, .. } = self.misfit(camera)?;
        let size = residual.dot(&(weight * residual)).max(0.0).sqrt();
        Some(size.copysign(residual.x))
    }

    /// How long a length is before this camera, m, and the log sd of what was told of it, that of its pixels counted; `None` for
    /// other factors and where a pixel shows no ground.
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
            Self::InverseFocal { per_px, sd } => {
                let residual = (per_px - (-camera[0]).exp()) / sd;
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
            Self::Upright { .. } => {
                let [level, steep] = self.readings(camera)?;
                let (of_level, of_steep) = (level.density()?, steep.density()?);
                let total = of_level.0 + of_steep.0;
                let weight = (of_level.0 * of_level.1 + of_steep.0 * of_steep.1) / total;
                let cost = -total.ln();
                cost.is_finite().then_some(Misfit { residual: level.residual, weight, cost })
            }
        }
    }

    /// The two Gaussians that a factor may mean before a camera: a level street, a steep one. `None` of factors that mean one thing. The
    /// join takes them by expectation propagation.
    #[must_use]
    pub fn readings(&self, camera: &Vector4<f64>) -> Option<[Reading; 2]> {
        let Self::Upright { bend, roll, covariance } = *self else { return None };
        let params = CameraParams::from_vector(camera);
        let (tan, cos) = (params.tilt.tan(), params.tilt.cos());
        let residual = Vector2::new(bend - tan / params.focal_px(), roll - params.roll);
        let sloped = |slope_sd: f64, share: f64| {
            let of_slope = Vector2::new(1.0 / (cos * cos * params.focal_px()), 1.0 / cos) * slope_sd;
            let covariance = covariance + Matrix2::from_diagonal(&of_slope.component_mul(&of_slope));
            Reading { share, residual, covariance }
        };
        let steep = Self::STEEP_SHARE;
        Some([sloped(Self::SLOPE_SD, 1.0 - steep), sloped(Self::STEEP_SD, steep)])
    }

    /// Derivative of its residual by the camera; 0 where it makes no sense.
    #[must_use]
    pub fn residual_by_camera(&self, camera: &Vector4<f64>) -> SMatrix<f64, 2, 4> {
        self.derivatives(camera).1
    }

    /// Of cost and residual by the camera, by central differences.
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

    /// What it adds at a camera.
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
    /// Sum over factors.
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

/// Where a pixel's ray meets the ground, camera frame, m.
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
            Factor::InverseFocal { per_px: 1.0 / 1200.0, sd: 5e-6 },
            Factor::Camera { mean: camera(), information: correlated(), by_cars: false },
            length(project(-2.0, 18.0, 0.0), project(3.0, 18.0, 0.0)),
            length(project(0.0, 15.0, 0.0), project(3.0, 19.0, 0.0)),
            Factor::Upright {
                bend: 0.3f64.tan() / 1200.0,
                roll: 0.05,
                covariance: Matrix2::new(1e-10, 1e-8, 1e-8, 1e-5),
            },
        ]
    }

    fn correlated() -> Matrix4<f64> {
        Matrix4::from_fn(|r, c| if r == c { 900.0 } else { 200.0 })
    }

    #[test]
    fn a_camera_without_scale_says_the_same_of_the_rest() {
        let factor = Factor::Camera { mean: camera(), information: correlated(), by_cars: false };
        let Some(Factor::Camera { information, .. }) = factor.without_scale() else { panic!("{factor:?}") };
        assert!(information.row(3).norm() + information.column(3).norm() < 1e-12);
        let marginal = correlated().try_inverse().unwrap().fixed_view::<3, 3>(0, 0).try_inverse().unwrap();
        assert!((information.fixed_view::<3, 3>(0, 0) - marginal).norm() < 1e-9);
        assert!(factors().iter().filter_map(Factor::without_scale).count() == 4);
    }

    #[test]
    fn a_true_clue_fits_the_true_camera_and_no_other() {
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
            let told = 2.0 * factor.terms(&at).gradient.dot(&step);
            assert!((change - told).abs() < 1e-3 * told.abs() + 1e-9, "{factor:?}: {change} {told}");
        }
    }

    #[test]
    fn the_vertical_of_the_scene_is_where_masts_point() {
        let params = CameraParams::from_vector(&camera());
        let project = |x: f64, y: f64, z: f64| {
            let point = params.plane().camera_from_world() * nalgebra::Point3::new(x, y, z);
            1200.0 * point.coords.xy() / point.z
        };
        let (bend, roll) = (params.tilt.tan() / params.focal_px(), params.roll);
        for (x, y) in [(3.0, 20.0), (-9.0, 40.0), (0.5, 15.0)] {
            let [foot, top] = [project(x, y, 0.0), project(x, y, 4.0)];
            let along = Vector2::new(roll.sin(), -roll.cos()) + bend * foot;
            let mast = top - foot;
            assert!(along.perp(&mast).abs() < 1e-9 * along.norm() * mast.norm());
        }
    }

    #[test]
    fn what_contradicts_as_a_steep_street_does_pulls_little() {
        let upright = |bend: f64| Factor::Upright {
            bend: bend.tan() / 1200.0,
            roll: 0.05,
            covariance: Matrix2::new(1e-12, 0.0, 0.0, 1e-6),
        };
        let [level, steep] = [0.31, 0.45].map(|tilt| upright(tilt).terms(&camera()).information[(1, 1)]);
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
