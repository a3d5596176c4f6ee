//! What cars say of a camera when their errors have something in common.
//!
//! A net sees the cars of one place from a little too high or too low, all of them alike: no number of cars averages that out.
//! So evidence is kept on six numbers, x = (log f, tilt, roll, log h | elevation, turn): the camera, and the error (rad) that all
//! cars of a place share of the angle at which they are seen from above, and of their turn about the line of sight. Evidence of
//! several pictures of a place adds up; only then are the two taken for what they are, errors of known sd, and integrated out.

use nalgebra::{Matrix2, Matrix4, Matrix6, SMatrix, Vector2, Vector4, Vector6};

/// sd of the errors that cars share: elevation, turn, rad. 0: cars share none.
pub type SharedSd = [f64; 2];

/// Gaussian evidence `exp(−½ xᵀ information x + vectorᵀ x)` on x as above, possibly singular.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointInformation {
    /// Inverse covariance.
    pub information: Matrix6<f64>,
    /// Times the mean.
    pub vector: Vector6<f64>,
}

impl JointInformation {
    /// Nothing said.
    #[must_use]
    pub fn none() -> Self {
        Self { information: Matrix6::zeros(), vector: Vector6::zeros() }
    }

    /// Evidence on the camera alone: its errors are not shared with anything.
    #[must_use]
    pub fn of_camera(information: &Matrix4<f64>, camera: &Vector4<f64>) -> Self {
        let mut joint = Self::none();
        joint.information.fixed_view_mut::<4, 4>(0, 0).copy_from(information);
        joint.vector.fixed_rows_mut::<4>(0).copy_from(&(information * camera));
        joint
    }

    /// What it says of the camera were there no shared error: inverse covariance.
    #[must_use]
    pub fn camera(&self) -> Matrix4<f64> {
        self.information.fixed_view::<4, 4>(0, 0).into_owned()
    }

    /// Adds a share of other evidence.
    pub fn add(&mut self, other: &Self, share: f64) {
        self.information += other.information * share;
        self.vector += other.vector * share;
    }

    /// What it says of the camera with the shared errors integrated out: inverse covariance, and that times the mean.
    #[must_use]
    pub fn marginal(&self, sd: SharedSd) -> (Matrix4<f64>, Vector4<f64>) {
        let cross = self.cross();
        let gain = cross * self.shared_covariance(sd);
        let information = self.camera() - gain * cross.transpose();
        let vector = self.vector.fixed_rows::<4>(0) - gain * self.vector.fixed_rows::<2>(4);
        ((information + information.transpose()) / 2.0, vector)
    }

    /// Changes what it says, not how well, so that with the shared errors integrated out it leads to this camera where something else
    /// pulls: `pull` is the gradient of that one's cost there.
    pub fn lead_to(&mut self, camera: &Vector4<f64>, pull: &Vector4<f64>, sd: SharedSd) {
        let cross = self.cross();
        let rest: Vector2<f64> = self.vector.fixed_rows::<2>(4) - cross.transpose() * camera;
        let shared = self.shared_covariance(sd) * rest;
        let vector = self.camera() * camera + cross * shared + pull;
        self.vector.fixed_rows_mut::<4>(0).copy_from(&vector);
    }

    fn cross(&self) -> SMatrix<f64, 4, 2> {
        self.information.fixed_view::<4, 2>(0, 4).into_owned()
    }

    /// Covariance of the shared errors were the camera known.
    fn shared_covariance(&self, sd: SharedSd) -> Matrix2<f64> {
        let own: Matrix2<f64> = self.information.fixed_view::<2, 2>(4, 4).into_owned();
        // (own + S⁻¹)⁻¹ with S = D²: D (D own D + 1)⁻¹ D, good for sds of 0, too.
        let d = Matrix2::from_diagonal(&Vector2::from(sd));
        let kept =
            (d * own * d + Matrix2::identity()).cholesky().map_or_else(Matrix2::zeros, |c| c.inverse());
        d * kept * d
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten cars of one place, each of which says (tilt + elevation error) to 0.01 rad, and the rest well.
    fn cars() -> JointInformation {
        let mut row = Vector6::zeros();
        (row[1], row[4]) = (100.0, 100.0);
        let mut joint = JointInformation::of_camera(&(Matrix4::identity() * 1e4), &Vector4::repeat(0.3));
        joint.information[(1, 1)] = 0.0;
        joint.vector[1] = 0.0;
        let one = JointInformation { information: row * row.transpose(), vector: row * 30.0 };
        for _ in 0..10 {
            joint.add(&one, 1.0);
        }
        joint
    }

    #[test]
    fn no_number_of_cars_averages_a_shared_error_out() {
        let sd = |shared: SharedSd| cars().marginal(shared).0.try_inverse().unwrap()[(1, 1)].sqrt();
        assert!((sd([0.0, 0.0]) - 0.01 / 10_f64.sqrt()).abs() < 1e-12);
        assert!((sd([0.02, 0.0]) - (0.02_f64.powi(2) + 1e-5).sqrt()).abs() < 1e-12);
        let (information, vector) = cars().marginal([0.02, 0.01]);
        let mean = information.try_inverse().unwrap() * vector;
        assert!((mean - Vector4::repeat(0.3)).amax() < 1e-9, "the mean of the error is 0: {mean}");
    }

    #[test]
    fn evidence_leads_where_it_is_told_to() {
        let (at, pull) = (Vector4::new(0.31, 0.28, 0.3, 0.33), Vector4::new(5.0, -20.0, 1.0, 0.0));
        for sd in [[0.0, 0.0], [0.02, 0.01]] {
            let mut joint = cars();
            joint.lead_to(&at, &pull, sd);
            let (information, vector) = joint.marginal(sd);
            assert!((information * at - vector + pull).amax() < 1e-8);
            assert_eq!(joint.information, cars().information);
        }
    }
}
