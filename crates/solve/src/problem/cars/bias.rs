//! The bias of the minimum, to second order. It is a fraction of one frame's sd, but the same in every frame. So it
//! would not average out when frames are fused.
//!
//! There are two causes. Keypoints are curved functions of the unknowns, so their squared errors shift the minimum (Box
//! 1971). And there are many cars with little information each (Neyman and Scott 1948). The joint minimum shrinks the
//! world, because in a smaller world all shape coefficients are nearer to their mean. The derivation treats shapes as
//! random with their prior, and positions of cars as fixed numbers.
//!
//! Let g be the gradient and H = Jᵀ J the Hessian of a car's cost by x = (pose, shape, camera). Let U Uᵀ be the
//! covariance of x, and Σ the covariance of pose and shape given the camera. Then
//!
//! ```text
//! e = ½ Σ_d ∂²g / ∂u_d²  −  Σ_pose i (∂H / ∂x_i) Σ_·i          δc = −C Σ_cars (dx / dc)ᵀ e         u_d: columns of U
//! ```
//!
//! makes c + δc, with covariance C, unbiased when frames are summed by their information. With positions from a flat
//! prior, the second term would vanish and c + δc would be the posterior's mean (Tierney and Kadane 1986). With the
//! prior's rows treated as keypoints, it is Box's formula plus two terms: the covariance of shapes and Jacobian (Stein
//! 1981), and that of information and error.

use nalgebra::{DMatrix, DVector, Matrix4, Vector4};

use super::CarsProblem;
use crate::linear::gram::{Gram, MAX_WIDTH};
use crate::model::pose::Pose;

/// Step of the finite differences, in sds.
const STEP: f64 = 1e-3;

impl<P: Pose<N>, const N: usize, const M: usize> CarsProblem<'_, P, N, M> {
    /// Returns the correction to add to the camera, whose `covariance` is given (zero where fixed).
    ///
    /// The correction is limited to one sd, since the second order is not accurate beyond. Call after `information`.
    /// Returns `None` if a car cannot be evaluated nearby.
    pub fn bias_correction(&mut self, covariance: &Matrix4<f64>) -> Option<Vector4<f64>> {
        let fixed = Matrix4::from_diagonal(&covariance.diagonal().map(|v| if v > 0.0 { 0.0 } else { 1.0 }));
        let root = (covariance + fixed).cholesky()?.l() - fixed;
        let of_camera = root.column_iter().map(|step| self.following(&step.into_owned()));
        let columns = (0..N + M).map(|d| self.own_column(d)).chain(of_camera);
        // U, with one block of rows per view.
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

    /// Returns the first term of e: the gradient's mean over the corners of a simplex minus the gradient in its middle.
    ///
    /// The simplex has the covariance U Uᵀ (Julier and Uhlmann 2002).
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

    /// Returns the second term of e for the pose's coordinate i.
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
