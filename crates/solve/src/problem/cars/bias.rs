//! Correction of the estimated camera's bias, to second order.
//!
//! The bias is a fraction of one frame's sd, but it is the same in every frame. So it would not average out when frames
//! are fused. The bias has two causes:
//!
//! - Projected keypoints are nonlinear functions of the unknowns. So squared errors shift the minimum (Box 1971).
//! - There are many cars, each with little information (Neyman and Scott 1948). At the joint minimum, the world is too
//!   small, because in a smaller world all shape coefficients are nearer to their mean.
//!
//! The derivation treats shapes as random with their prior, and positions of cars as fixed numbers. For one car:
//!
//! - x = (pose, shape, camera) are the unknowns, and c is the camera among them;
//! - g is the gradient of the car's cost with respect to x, and H = Jᵀ J is the Hessian, with the Jacobian J;
//! - C is the covariance of c, and Σ is the covariance of (pose, shape) for a fixed camera;
//! - U is a matrix with columns u_d, and U Uᵀ is the covariance of x.
//!
//! The correction δc of the camera is then
//!
//! ```text
//! e  = ½ Σ_d ∂²g / ∂u_d²  −  Σ_i (∂H / ∂x_i) Σ_·i        d: columns of U;  i: unknowns of the pose;  Σ_·i: column of Σ
//! δc = −C Σ_cars (dx / dc)ᵀ e
//! ```
//!
//! With this correction, c + δc is unbiased when frames are averaged with their information as weights. Under a flat
//! prior on positions, the second term of e would vanish. Then c + δc would be the posterior's mean (Tierney and Kadane
//! 1986).
//!
//! If the shape prior counts as further keypoints, the formula is Box's formula plus two terms. One is the covariance
//! between shapes and Jacobian (Stein 1981), and the other is the covariance between information and error.

use nalgebra::{DMatrix, DVector, Matrix4, Vector4};

use super::CarsProblem;
use crate::linear::gram::{Gram, MAX_WIDTH};
use crate::model::pose::Pose;

/// Step of the finite differences, in standard deviations.
const STEP: f64 = 1e-3;

impl<P: Pose<N>, const N: usize, const M: usize> CarsProblem<'_, P, N, M> {
    /// Returns the correction that must be added to the camera (log f, tilt, roll, log h).
    ///
    /// `covariance` is the covariance of the camera, with zero rows for fixed parameters. The correction is limited to
    /// one sd, because the second-order formula is not accurate for larger corrections. Call after `information`.
    /// Returns `None` if the cost cannot be evaluated near the minimum.
    pub fn bias_correction(&mut self, covariance: &Matrix4<f64>) -> Option<Vector4<f64>> {
        let fixed = Matrix4::from_diagonal(&covariance.diagonal().map(|v| if v > 0.0 { 0.0 } else { 1.0 }));
        let root = (covariance + fixed).cholesky()?.l() - fixed;
        let of_camera = root.column_iter().map(|step| self.following(&step.into_owned()));
        let columns = (0..N + M).map(|d| self.own_column(d)).chain(of_camera);
        // The matrix U, with one block of rows per view.
        let columns: Vec<_> = columns.map(|steps| DVector::from_vec(steps.concat())).collect();
        let columns = DMatrix::from_columns(&columns);
        let mut e = self.curvature(&columns)?;
        for i in 0..N {
            e -= self.turn_of_hessian(i, &columns)?;
        }
        let trust = self.views.iter().flat_map(|view| [self.groups[view.group].trust; MAX_WIDTH]);
        e.component_mul_assign(&DVector::from_iterator(e.len(), trust));
        let in_sds = columns.fixed_columns::<4>(N + M).tr_mul(&e);
        let change = -(root * in_sds) / in_sds.norm().max(1.0);
        change.iter().all(|v| v.is_finite()).then_some(change)
    }

    /// Returns the first term of the vector e (see the top of this file): the curvature of the gradient g.
    ///
    /// The term is the mean of g over the corners of a simplex, minus g at the centre of the simplex. The corners have
    /// the covariance U Uᵀ (Julier and Uhlmann 2002).
    fn curvature(&mut self, columns: &DMatrix<f64>) -> Option<DVector<f64>> {
        let corners = columns.ncols() as f64 + 1.0;
        let (sum, root) = (columns.column_sum(), corners.sqrt());
        let shift = &sum * ((1.0 - root) / (corners - 1.0));
        let mut mean = DVector::zeros(columns.nrows());
        for corner in columns.column_iter().map(|column| column * root + &shift).chain([-&sum]) {
            self.evaluate_at(corner.as_slice(), STEP)?;
            let grams = self.trial_linearisation.grams.iter().zip(&self.linearisation.grams);
            for (k, (there, here)) in grams.enumerate() {
                for i in 0..Gram::<N, M>::RESIDUAL {
                    mean[k * MAX_WIDTH + i] += (there.gradient(i) - here.gradient(i)) / corners;
                }
            }
        }
        Some(mean / (STEP * STEP))
    }

    /// Returns the i-th summand in the second term of the vector e (see the top of this file).
    ///
    /// It follows from the change of the Hessian when the i-th unknown of the pose changes.
    fn turn_of_hessian(&mut self, i: usize, columns: &DMatrix<f64>) -> Option<DVector<f64>> {
        let (mut steps, mut covariances) = (DVector::zeros(columns.nrows()), DVector::zeros(columns.nrows()));
        for first in (0..columns.nrows()).step_by(MAX_WIDTH) {
            let own = columns.view((first, 0), (MAX_WIDTH, N + M));
            let covariance = own * own.row(i).transpose();
            steps[first + i] = covariance[i].sqrt();
            covariances.rows_mut(first, MAX_WIDTH).copy_from(&covariance);
        }
        self.evaluate_at(steps.as_slice(), STEP)?;
        let grams = self.trial_linearisation.grams.iter().zip(&self.linearisation.grams);
        for (k, (there, here)) in grams.enumerate() {
            let covariance = &mut covariances.as_mut_slice()[k * MAX_WIDTH..][..MAX_WIDTH];
            let turns = there.times(covariance).into_iter().zip(here.times(covariance));
            for (entry, (there, here)) in covariance.iter_mut().zip(turns) {
                *entry = (there - here) / (STEP * steps[k * MAX_WIDTH + i]);
            }
        }
        Some(covariances)
    }
}
