//! Factors: evidence on the camera that does not come from keypoints of cars.
//!
//! A factor compares a measured value with the value that a camera (log f, tilt, roll, log h) predicts. The error of the
//! measurement is Gaussian, or a mixture of Gaussians. Pixels are undistorted and relative to the principal point.
//! [`fuse`](crate::fuse) joins all factors with the evidence of cars. A new cue is one new file with a variant of
//! [`Factor`].

mod length;
mod residual;
mod survey;
mod vertical;

use std::ops::{Div, Sub};

use nalgebra::{DVector, MatrixXx4, Vector4};

pub use self::length::Length;
pub(crate) use self::residual::{Component, Residual};
pub use self::survey::Survey;
pub use self::vertical::VerticalVanishingPoint;

/// A factor on the camera.
#[derive(Clone, Debug, PartialEq)]
pub enum Factor {
    /// Measured camera parameters.
    Survey(Survey),
    /// A known distance on the ground.
    Length(Length),
    /// The vanishing point of vertical lines.
    Vertical(VerticalVanishingPoint),
}

/// Largest sd of log focal length for which a cue counts. A Gaussian does not describe a wider distribution.
pub(crate) const WEAKEST: f64 = 0.25;
/// Step of central differences: rad for angles, and without unit for logarithms.
const STEP: f64 = 1e-5;

/// Returns the derivatives of a function of the camera by (log f, tilt, roll, log h); `None` where it has no value.
#[must_use]
pub fn derivatives_by_camera<V>(
    of: impl Fn(&Vector4<f64>) -> Option<V>,
    camera: &Vector4<f64>,
) -> Option<[V; 4]>
where
    V: Sub<Output = V> + Div<f64, Output = V>,
{
    let by = |i: usize| {
        let step = Vector4::ith(i, STEP);
        Some((of(&(camera + step))? - of(&(camera - step))?) / (2.0 * STEP))
    };
    Some([by(0)?, by(1)?, by(2)?, by(3)?])
}

impl Factor {
    /// Returns the residual at a camera; `None` if the factor cannot be evaluated there.
    pub(crate) fn residual(&self, camera: &Vector4<f64>) -> Option<Residual> {
        let by_camera = derivatives_by_camera(|camera| Some(self.error(camera)?.0), camera)?;
        let (value, components) = self.error(camera)?;
        Some(Residual { value, by_camera: MatrixXx4::from_columns(&by_camera), components })
    }

    /// Returns the negative log likelihood of a camera, up to a constant. `None` if it cannot be evaluated.
    #[must_use]
    pub fn cost(&self, camera: &Vector4<f64>) -> Option<f64> {
        let (value, components) = self.error(camera)?;
        let density: f64 = components.iter().map(|component| component.density(&value)).sum();
        Some(-density.ln())
    }

    /// Returns the error at a camera, measured minus predicted, and the components of its distribution.
    fn error(&self, camera: &Vector4<f64>) -> Option<(DVector<f64>, Vec<Component>)> {
        match self {
            Self::Survey(survey) => Some(survey.error(camera)),
            Self::Length(length) => length.error(camera),
            Self::Vertical(vertical) => vertical.error(camera),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Matrix4, Point3, Vector2};
    use roadplane_base::CameraParams;

    use super::*;

    fn camera() -> Vector4<f64> {
        Vector4::new(1200f64.ln(), 0.3, 0.05, 8f64.ln())
    }

    /// Projects a point of the world, px from the principal point.
    fn project(x: f64, y: f64, z: f64) -> Vector2<f64> {
        let params = CameraParams::from_vector(&camera());
        let point = params.plane().camera_from_world() * Point3::new(x, y, z);
        params.focal_px() * point.coords.xy() / point.z
    }

    fn vertical(tilt: f64) -> Factor {
        Factor::Vertical(VerticalVanishingPoint {
            inverse_distance: tilt.tan() / 1200.0,
            roll: 0.05,
            covariance: Matrix2::new(1e-12, 0.0, 0.0, 1e-6),
        })
    }

    fn factors() -> Vec<Factor> {
        let length = |ends_px: [Vector2<f64>; 2]| {
            Factor::Length(Length { ends_px, end_sd_px: 0.5, length_m: 5.0, log_sd: 0.01 })
        };
        let information = Matrix4::from_fn(|r, c| if r == c { 900.0 } else { 200.0 });
        vec![
            Factor::Survey(Survey { mean: camera(), information, by_cars: false }),
            length([project(-2.0, 18.0, 0.0), project(3.0, 18.0, 0.0)]),
            length([project(0.0, 15.0, 0.0), project(3.0, 19.0, 0.0)]),
            vertical(0.3),
        ]
    }

    #[test]
    fn a_true_factor_fits_the_true_camera_and_no_other() {
        let tilted = camera() + Vector4::new(0.02, 0.1, 0.0, 0.0);
        for factor in factors() {
            assert!(factor.residual(&camera()).unwrap().value.amax() < 1e-9, "{factor:?}");
            let gain = factor.cost(&tilted).unwrap() - factor.cost(&camera()).unwrap();
            assert!(gain > 0.05, "{factor:?}: {gain}");
        }
    }

    #[test]
    fn the_derivative_is_that_of_the_residual() {
        let at = camera() + Vector4::new(0.01, -0.008, 0.004, 0.02);
        let step = Vector4::new(3e-4, 2e-4, -1e-4, 2e-4);
        for factor in factors() {
            let value = |camera: Vector4<f64>| factor.residual(&camera).unwrap().value;
            let change = value(at + step) - value(at - step);
            let expected = factor.residual(&at).unwrap().by_camera * step * 2.0;
            assert!((&change - &expected).norm() < 1e-4 * expected.norm(), "{factor:?}: {change} {expected}");
        }
    }

    #[test]
    fn masts_point_to_the_vertical_vanishing_point() {
        let params = CameraParams::from_vector(&camera());
        let (inverse_distance, roll) = (params.tilt.tan() / params.focal_px(), params.roll);
        for (x, y) in [(3.0, 20.0), (-9.0, 40.0), (0.5, 15.0)] {
            let [foot, top] = [project(x, y, 0.0), project(x, y, 4.0)];
            let along = Vector2::new(roll.sin(), -roll.cos()) + inverse_distance * foot;
            let mast = top - foot;
            assert!(along.perp(&mast).abs() < 1e-9 * along.norm() * mast.norm());
        }
    }

    #[test]
    fn a_vertical_of_a_steep_street_is_weaker() {
        // The cost grows less beyond the slopes of level streets.
        let slope = |tilt: f64| {
            let cost = |tilt: f64| vertical(tilt).cost(&camera()).unwrap();
            cost(tilt + 1e-3) - cost(tilt - 1e-3)
        };
        assert!(slope(0.45) < 0.3 * slope(0.325), "{} {}", slope(0.45), slope(0.325));
    }

    #[test]
    fn pixels_in_the_sky_have_no_length() {
        let ends_px = [Vector2::new(0.0, -900.0), Vector2::new(50.0, -900.0)];
        let sky = Factor::Length(Length { ends_px, end_sd_px: 1.0, length_m: 5.0, log_sd: 0.01 });
        assert!(sky.residual(&camera()).is_none() && sky.cost(&camera()).is_none());
    }
}
