//! Information that cars give on a camera, if all cars of a scene share some errors.
//!
//! For example, the keypoints of all cars may suggest a viewing direction that is slightly too steep. The mean over
//! many cars does not reduce such an error. Therefore the information on x = (log focal, tilt, roll, log height) has
//! two parts:
//!
//! - I, the information matrix (inverse covariance) of x, computed as if the errors of the cars were independent;
//! - C, the cross information between x and the shared errors s.
//!
//! The shared errors are the elevation angle of the view (rad), the turn about the viewing axis (rad), the lens
//! distortion (1/px²) and the principal point (px). Information from several frames of a scene is summed first. Then
//! the shared errors, which have the given covariance S, enlarge the covariance of x to `Σ = I⁻¹ + G S Gᵀ` with
//! `G = −I⁻¹ C`.

use nalgebra::{Matrix4, Matrix4x5, Matrix5, Vector4, Vector5};

/// Number of errors that the cars of a scene share.
pub const SHARED_ERRORS: usize = 5;

/// Sds of the shared errors. An sd of 0 means that the cars do not share the error.
///
/// The order is: elevation (rad), turn (rad), lens distortion ([`Lens::per_px2`](crate::Lens::per_px2), 1/px²), and x
/// and y of the principal point (px). If the principal point shifts, the ray through the middle of the image stays
/// fixed. Tilt and roll refer to this ray.
pub type SharedSd = [f64; SHARED_ERRORS];

/// Gaussian information on (log focal, tilt, roll, log height) and the shared errors. It may be singular.
///
/// The sds of the shared errors change the covariance of the camera parameters but not their mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointInformation {
    /// Inverse covariance of the camera parameters, without shared errors.
    pub information: Matrix4<f64>,
    /// Cross information between the camera parameters (rows) and the shared errors (columns).
    pub cross: Matrix4x5<f64>,
    /// `information` times the mean of the camera parameters.
    pub vector: Vector4<f64>,
}

impl JointInformation {
    /// Returns zero information.
    #[must_use]
    pub fn none() -> Self {
        Self { information: Matrix4::zeros(), cross: Matrix4x5::zeros(), vector: Vector4::zeros() }
    }

    /// Creates information on the camera parameters without shared errors. Their mean is `camera`.
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

    /// Returns the inverse covariance of the camera parameters, and its product with their mean.
    ///
    /// The shared errors, whose sds are `sd`, are marginalised out.
    #[must_use]
    pub fn marginal(&self, sd: SharedSd) -> (Matrix4<f64>, Vector4<f64>) {
        let solved = self.solved_cross();
        // With S = D², the gain C (S⁻¹ + Cᵀ I⁻¹ C)⁻¹ equals C D (D Cᵀ I⁻¹ C D + 1)⁻¹ D. The second form is also valid
        // for sds of 0.
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

    /// Returns the same information with a mean for which `camera` minimises the total cost.
    ///
    /// The total cost is the cost of this information plus other costs. `pull` is the gradient of the other costs at
    /// `camera`. The shared errors, whose sds are `sd`, are marginalised out.
    #[must_use]
    pub fn with_minimum_at(&self, camera: &Vector4<f64>, pull: &Vector4<f64>, sd: SharedSd) -> Self {
        let variance = Matrix5::from_diagonal(&Vector5::from(sd).map(|sd| sd * sd));
        let shared = self.cross * (variance * (self.solved_cross().transpose() * pull));
        Self { vector: self.information * camera + pull + shared, ..*self }
    }

    /// Returns `I⁻¹ C`. In directions in which I is singular, C is zero, and the result is zero.
    fn solved_cross(&self) -> Matrix4x5<f64> {
        let floor = 1e-12 * self.information.trace().max(1e-12);
        let inverse = (self.information + Matrix4::identity() * floor).try_inverse();
        inverse.map_or_else(Matrix4x5::zeros, |inverse| inverse * self.cross)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the information of ten cars of one scene. Each car measures all parameters with an sd of 0.01. Its tilt
    /// includes the shared elevation error.
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
