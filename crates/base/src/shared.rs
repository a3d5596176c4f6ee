//! Information of cars on a camera when all cars of a scene share some errors.
//!
//! A net sees all cars of a scene from a little too high or too low. No number of cars averages such an error out.
//! Evidence on x = (log f, tilt, roll, log h) therefore has two parts:
//!
//! - the information I on x as if the cars' errors were independent;
//! - the cross information C between x and the shared errors s.
//!
//! The shared errors are the elevation angle of the view, the turn about the line of sight (both rad), the lens
//! distortion (1/px²), and the principal point (px). Evidence of several frames of a scene is summed first. Then s,
//! whose covariance S is known, widens the covariance of x: `Σ = I⁻¹ + G S Gᵀ` with `G = −I⁻¹ C`.

use nalgebra::{Matrix4, Matrix4x5, Matrix5, Vector4, Vector5};

/// Number of errors that the cars of a scene share.
pub const SHARED_ERRORS: usize = 5;

/// sds of the shared errors; 0 means that cars do not share the error.
///
/// In this order: elevation and turn, rad; the lens ([`Lens::per_px2`](crate::Lens::per_px2)), 1/px²; the principal
/// point, x and y, px. A shift of the principal point keeps the ray through the image's middle, to which tilt and roll
/// belong.
pub type SharedSd = [f64; SHARED_ERRORS];

/// Gaussian information on (log f, tilt, roll, log h) and the shared errors, possibly singular.
///
/// The shared errors' sds change the camera's covariance but not its mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointInformation {
    /// Inverse covariance of the camera without shared errors.
    pub information: Matrix4<f64>,
    /// Cross information: camera (rows) by shared errors (columns).
    pub cross: Matrix4x5<f64>,
    /// `information` times the mean.
    pub vector: Vector4<f64>,
}

impl JointInformation {
    /// Returns zero information.
    #[must_use]
    pub fn none() -> Self {
        Self { information: Matrix4::zeros(), cross: Matrix4x5::zeros(), vector: Vector4::zeros() }
    }

    /// Creates information on the camera without shared errors.
    #[must_use]
    pub fn of_camera(information: &Matrix4<f64>, camera: &Vector4<f64>) -> Self {
        Self { information: *information, cross: Matrix4x5::zeros(), vector: information * camera }
    }

    /// Adds other information, multiplied by `share`.
    pub fn add(&mut self, other: &Self, share: f64) {
        self.information += other.information * share;
        self.cross += other.cross * share;
        self.vector += other.vector * share;
    }

    /// Returns the camera's inverse covariance with the shared errors marginalised, and its product with the mean.
    #[must_use]
    pub fn marginal(&self, sd: SharedSd) -> (Matrix4<f64>, Vector4<f64>) {
        let solved = self.solved_cross();
        // C (S⁻¹ + Cᵀ I⁻¹ C)⁻¹ with S = D²: C D (D Cᵀ I⁻¹ C D + 1)⁻¹ D, which also holds for sds of 0.
        let d = Matrix5::from_diagonal(&Vector5::from(sd));
        let own = d * self.cross.transpose() * solved * d;
        let kept = (own + Matrix5::identity()).try_inverse().unwrap_or_else(Matrix5::zeros);
        let gain = self.cross * (d * kept * d);
        let information = self.information - gain * self.cross.transpose();
        (
            (information + information.transpose()) / 2.0,
            self.vector - gain * (solved.transpose() * self.vector),
        )
    }

    /// Returns the same information with another mean, so that together with other costs `camera` is the minimum.
    ///
    /// `pull` is the gradient of the other costs at `camera`. The shared errors are marginalised.
    #[must_use]
    pub fn with_minimum_at(&self, camera: &Vector4<f64>, pull: &Vector4<f64>, sd: SharedSd) -> Self {
        let variance = Matrix5::from_diagonal(&Vector5::from(sd).map(|sd| sd * sd));
        let shared = self.cross * (variance * (self.solved_cross().transpose() * pull));
        Self { vector: self.information * camera + pull + shared, ..*self }
    }

    /// Returns `I⁻¹ C`; in directions in which I is singular, C is zero.
    fn solved_cross(&self) -> Matrix4x5<f64> {
        let floor = 1e-12 * self.information.trace().max(1e-12);
        let inverse = (self.information + Matrix4::identity() * floor).try_inverse();
        inverse.map_or_else(Matrix4x5::zeros, |inverse| inverse * self.cross)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten cars of one scene, each of which measures all parameters, and (tilt + elevation error) to 0.01 rad.
    fn cars() -> JointInformation {
        let mut joint = JointInformation::of_camera(&(Matrix4::identity() * 1e4), &Vector4::repeat(0.3));
        joint.add(&joint.clone(), 9.0);
        joint.cross[(1, 0)] = joint.information[(1, 1)];
        joint
    }

    #[test]
    fn no_number_of_cars_averages_a_shared_error_out() {
        let sd = |shared: SharedSd| cars().marginal(shared).0.try_inverse().unwrap()[(1, 1)].sqrt();
        assert!((sd([0.0; 5]) - 0.01 / 10_f64.sqrt()).abs() < 1e-9);
        assert!((sd([0.02, 0.0, 0.0, 0.0, 0.0]) - (0.02_f64.powi(2) + 1e-5).sqrt()).abs() < 1e-9);
        let (information, vector) = cars().marginal([0.02, 0.01, 0.0, 0.0, 0.0]);
        let mean = information.try_inverse().unwrap() * vector;
        assert!((mean - Vector4::repeat(0.3)).amax() < 1e-9, "the mean stays: {mean}");
    }

    #[test]
    fn the_minimum_is_at_the_given_camera() {
        let (at, pull) = (Vector4::new(0.31, 0.28, 0.3, 0.33), Vector4::new(5.0, -20.0, 1.0, 0.0));
        for sd in [[0.0; 5], [0.02, 0.01, 0.0, 0.0, 0.0]] {
            let joint = cars().with_minimum_at(&at, &pull, sd);
            let (information, vector) = joint.marginal(sd);
            assert!((information * at - vector + pull).amax() < 1e-6);
            assert_eq!(joint.information, cars().information);
        }
    }

    #[test]
    fn singular_information_is_widened_in_its_other_directions() {
        let mut joint = cars();
        joint.information[(0, 0)] = 0.0;
        joint.vector[0] = 0.0;
        let (information, _) = joint.marginal([0.02, 0.0, 0.0, 0.0, 0.0]);
        assert!(information[(0, 0)].abs() < 1e-6);
        assert!((information[(1, 1)] * (0.02_f64.powi(2) + 1e-5) - 1.0).abs() < 1e-3);
    }
}
