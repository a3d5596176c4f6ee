//! What cars say of a camera when their errors have something in common.
//!
//! A net sees the cars of one place from a little too high or too low, all of them alike: no number of cars averages that out. So
//! beside the information on x = (log f, tilt, roll, log h) that evidence holds were cars' errors independent, it is kept how the
//! camera it leads to moves with the errors s that all cars of a place share: of the angle at which they are seen from above, of
//! their turn about the line of sight (rad), of what is known of the lens (1/px²), and of the principal point (px). Evidence of
//! several pictures of a place adds up; only then is s taken for what it is, an error of known sd: `Σ = I⁻¹ + G S Gᵀ`, with
//! `G = −I⁻¹ C` of the information I and its cross part C between x and s.

use nalgebra::{Matrix4, Matrix4x5, Matrix5, Vector4, Vector5};

/// Errors that the cars of a place share.
pub const SHARED_ERRORS: usize = 5;

/// sd of each: elevation and turn, rad; the lens ([`Lens::per_px2`](crate::Lens::per_px2)), 1/px²; the principal point, x and y, px,
/// while tilt and roll are those of the ray through the picture's middle, which it hardly moves. 0: cars share none.
pub type SharedSd = [f64; SHARED_ERRORS];

/// Gaussian evidence on x as above, possibly singular. It leads to the same camera whatever the shared errors' sd is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointInformation {
    /// Inverse covariance, were nothing shared.
    pub information: Matrix4<f64>,
    /// Its cross part: camera by shared errors.
    pub cross: Matrix4x5<f64>,
    /// `information` times the mean.
    pub vector: Vector4<f64>,
}

impl JointInformation {
    /// Nothing said.
    #[must_use]
    pub fn none() -> Self {
        Self { information: Matrix4::zeros(), cross: Matrix4x5::zeros(), vector: Vector4::zeros() }
    }

    /// Evidence on the camera alone: its errors are not shared with anything.
    #[must_use]
    pub fn of_camera(information: &Matrix4<f64>, camera: &Vector4<f64>) -> Self {
        Self { information: *information, cross: Matrix4x5::zeros(), vector: information * camera }
    }

    /// Adds a share of other evidence.
    pub fn add(&mut self, other: &Self, share: f64) {
        self.information += other.information * share;
        self.cross += other.cross * share;
        self.vector += other.vector * share;
    }

    /// What it says of the camera with the shared errors counted: inverse covariance, and that times the mean.
    #[must_use]
    pub fn marginal(&self, sd: SharedSd) -> (Matrix4<f64>, Vector4<f64>) {
        let seen = self.seen();
        // C (S⁻¹ + Cᵀ I⁻¹ C)⁻¹ with S = D²: C D (D Cᵀ I⁻¹ C D + 1)⁻¹ D, good for sds of 0, too.
        let d = Matrix5::from_diagonal(&Vector5::from(sd));
        let own = d * self.cross.transpose() * seen * d;
        let kept = (own + Matrix5::identity()).try_inverse().unwrap_or_else(Matrix5::zeros);
        let gain = self.cross * (d * kept * d);
        let information = self.information - gain * self.cross.transpose();
        ((information + information.transpose()) / 2.0, self.vector - gain * (seen.transpose() * self.vector))
    }

    /// Evidence as good as this that, with the shared errors counted, leads to this camera where something else pulls: `pull` is the
    /// gradient of that one's cost there.
    #[must_use]
    pub fn leading_to(&self, camera: &Vector4<f64>, pull: &Vector4<f64>, sd: SharedSd) -> Self {
        let variance = Matrix5::from_diagonal(&Vector5::from(sd).map(|sd| sd * sd));
        let shared = self.cross * (variance * (self.seen().transpose() * pull));
        Self { vector: self.information * camera + pull + shared, ..*self }
    }

    /// `I⁻¹ C`; where the information is singular C has nothing.
    fn seen(&self) -> Matrix4x5<f64> {
        let floor = 1e-12 * self.information.trace().max(1e-12);
        let inverse = (self.information + Matrix4::identity() * floor).try_inverse();
        inverse.map_or_else(Matrix4x5::zeros, |inverse| inverse * self.cross)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten cars of one place, each of which says (tilt + elevation error) to 0.01 rad, and the rest well.
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
    fn evidence_leads_where_it_is_told_to() {
        let (at, pull) = (Vector4::new(0.31, 0.28, 0.3, 0.33), Vector4::new(5.0, -20.0, 1.0, 0.0));
        for sd in [[0.0; 5], [0.02, 0.01, 0.0, 0.0, 0.0]] {
            let joint = cars().leading_to(&at, &pull, sd);
            let (information, vector) = joint.marginal(sd);
            assert!((information * at - vector + pull).amax() < 1e-6);
            assert_eq!(joint.information, cars().information);
        }
    }

    #[test]
    fn evidence_that_leaves_something_open_is_widened_in_the_rest() {
        let mut joint = cars();
        joint.information[(0, 0)] = 0.0;
        joint.vector[0] = 0.0;
        let (information, _) = joint.marginal([0.02, 0.0, 0.0, 0.0, 0.0]);
        assert!(information[(0, 0)].abs() < 1e-6);
        assert!((information[(1, 1)] * (0.02_f64.powi(2) + 1e-5) - 1.0).abs() < 1e-3);
    }
}
