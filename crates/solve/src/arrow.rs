//! Normal equations of a scene and their elimination.
//!
//! Unknowns: camera c (4), per group (physical car) a shape s (6), per view of it a pose v (3). A view touches only its own
//! pose, its group's shape and the camera, so with g = (c, s) the Hessian is an arrow in two levels:
//!
//! ```text
//! per view     A = H_gg − H_vgᵀ H_vv⁻¹ H_vg            10 × 10, summed over the group's views, plus the shape prior
//! per group    S = A_cc − A_csᵀ A_ss⁻¹ A_cs             4 × 4, summed over groups, plus the camera prior
//! ```
//!
//! Elimination is linear in views; nothing is allocated. The same factors give every covariance (`damping = 0`).

use nalgebra::{Cholesky, Const, Matrix3, Matrix4, Matrix6, SMatrix, SVector, Vector3, Vector4, Vector6};
use roadplane_base::MODES;

use crate::ground_residual::{COLUMNS, Row};

/// Information that every pose coordinate has at least: one that nobody sees gets an sd of 1e6, not a singular matrix.
pub(crate) const MIN_INFORMATION: f64 = 1e-12;

/// Camera and shape together.
pub(crate) const SHARED: usize = 4 + MODES;

/// Diagonal entries are damped as if at least this large, so that unseen directions are held too.
const MIN_DIAGONAL: f64 = 1e-9;

/// One view's share of Hessian and gradient, and its eliminated form `v = gain · (c, s) + offset`.
#[derive(Clone, Debug)]
pub(crate) struct ViewBlock {
    sum: [[f64; 16]; COLUMNS],
    gradient: [f64; 16],
    gain: SMatrix<f64, 3, SHARED>,
    offset: Vector3<f64>,
    inverse: Matrix3<f64>,
}

/// One group's shape: `s = gain · c + offset`.
#[derive(Clone, Debug)]
pub(crate) struct GroupBlock {
    /// Coefficients held this iteration (at a bound, or fixed).
    pub held: [bool; MODES],
    /// Gradient by shape, all of it.
    pub gradient: Vector6<f64>,
    /// Diagonal of the undamped Hessian.
    pub diagonal: Vector6<f64>,
    gain: SMatrix<f64, MODES, 4>,
    offset: Vector6<f64>,
    inverse: Matrix6<f64>,
}

impl ViewBlock {
    pub fn zeros() -> Self {
        Self {
            sum: [[0.0; 16]; COLUMNS],
            gradient: [0.0; 16],
            gain: SMatrix::zeros(),
            offset: Vector3::zeros(),
            inverse: Matrix3::zeros(),
        }
    }

    pub fn clear(&mut self) {
        self.sum = [[0.0; 16]; COLUMNS];
        self.gradient = [0.0; 16];
    }

    /// Adds `weight · (row rowᵀ)` and `weight · row · residual` for the two rows of a keypoint. Only the upper triangle is
    /// kept, in bands of whole SIMD registers.
    #[inline]
    pub fn add(&mut self, rows: &[Row; 2], residual: [f64; 2], weight: f64) {
        self.add_band::<0>(rows, weight);
        self.add_band::<4>(rows, weight);
        self.add_band::<8>(rows, weight);
        self.add_band::<12>(rows, weight);
        let (p, q) = (weight * residual[0], weight * residual[1]);
        for (i, sum) in self.gradient.iter_mut().enumerate() {
            *sum += p * rows[0][i] + q * rows[1][i];
        }
    }

    /// Rows FROM … FROM + 3 of the triangle, columns from FROM on.
    #[inline]
    fn add_band<const FROM: usize>(&mut self, rows: &[Row; 2], weight: f64) {
        for a in FROM..(FROM + 4).min(COLUMNS) {
            let (p, q) = (weight * rows[0][a], weight * rows[1][a]);
            let sums = &mut self.sum[a];
            for b in FROM..16 {
                sums[b] += p * rows[0][b] + q * rows[1][b];
            }
        }
    }

    /// An entry of the symmetric Hessian.
    #[inline]
    fn entry(&self, i: usize, j: usize) -> f64 {
        self.sum[i.min(j)][i.max(j)]
    }

    /// Diagonal of the pose's block.
    pub fn pose_diagonal(&self) -> Vector3<f64> {
        Vector3::from_fn(|i, _| self.sum[SHARED + i][SHARED + i])
    }

    /// Gradient by pose.
    pub fn pose_gradient(&self) -> Vector3<f64> {
        Vector3::from_fn(|i, _| self.gradient[SHARED + i])
    }

    /// Hessian of (camera, shape).
    pub fn shared_hessian(&self) -> SMatrix<f64, SHARED, SHARED> {
        SMatrix::from_fn(|i, j| self.entry(i, j))
    }

    /// Its diagonal.
    pub fn shared_diagonal(&self) -> SVector<f64, SHARED> {
        SVector::from_fn(|i, _| self.sum[i][i])
    }

    /// Gradient of (camera, shape).
    pub fn shared_gradient(&self) -> SVector<f64, SHARED> {
        SVector::from_fn(|i, _| self.gradient[i])
    }

    /// Eliminates the pose and adds what remains to the group's system. `None` when its block is not positive definite.
    fn eliminate(
        &mut self,
        damping: f64,
        hessian: &mut SMatrix<f64, SHARED, SHARED>,
        gradient: &mut SVector<f64, SHARED>,
    ) -> Option<()> {
        let mut block = Matrix3::from_fn(|i, j| self.entry(SHARED + i, SHARED + j));
        for i in 0..3 {
            block[(i, i)] += damping * block[(i, i)].max(MIN_DIAGONAL) + MIN_INFORMATION;
        }
        self.inverse = Cholesky::new(block)?.inverse();
        let cross = SMatrix::<f64, 3, SHARED>::from_fn(|i, j| self.entry(SHARED + i, j));
        self.gain = -(self.inverse * cross);
        self.offset = -(self.inverse * self.pose_gradient());
        *hessian += self.shared_hessian() + cross.tr_mul(&self.gain);
        *gradient += self.shared_gradient() + cross.tr_mul(&self.offset);
        Some(())
    }

    /// Pose step that belongs to a step of (camera, shape).
    pub fn pose_step(&self, shared: &SVector<f64, SHARED>) -> Vector3<f64> {
        self.gain * shared + self.offset
    }

    /// Covariance of (camera, shape, pose) from that of (camera, shape).
    pub fn joint_covariance(&self, shared: &SMatrix<f64, SHARED, SHARED>) -> SMatrix<f64, COLUMNS, COLUMNS> {
        let cross = self.gain * shared;
        let pose = self.inverse + cross * self.gain.transpose();
        let mut joint = SMatrix::<f64, COLUMNS, COLUMNS>::zeros();
        joint.fixed_view_mut::<SHARED, SHARED>(0, 0).copy_from(shared);
        joint.fixed_view_mut::<3, SHARED>(SHARED, 0).copy_from(&cross);
        joint.fixed_view_mut::<SHARED, 3>(0, SHARED).copy_from(&cross.transpose());
        joint.fixed_view_mut::<3, 3>(SHARED, SHARED).copy_from(&pose);
        joint
    }
}

impl GroupBlock {
    pub fn zeros() -> Self {
        Self {
            held: [false; MODES],
            gradient: Vector6::zeros(),
            diagonal: Vector6::zeros(),
            gain: SMatrix::zeros(),
            offset: Vector6::zeros(),
            inverse: Matrix6::zeros(),
        }
    }

    /// Eliminates the group's views and shape; adds what remains to the camera's system.
    pub fn eliminate(
        &mut self,
        views: &mut [ViewBlock],
        damping: f64,
        prior_information: &Matrix6<f64>,
        prior_gradient: &Vector6<f64>,
        camera_hessian: &mut Matrix4<f64>,
        camera_gradient: &mut Vector4<f64>,
    ) -> Option<()> {
        let mut hessian = SMatrix::<f64, SHARED, SHARED>::zeros();
        let mut gradient = SVector::<f64, SHARED>::zeros();
        for view in views {
            view.eliminate(damping, &mut hessian, &mut gradient)?;
        }
        let mut block: Matrix6<f64> = hessian.fixed_view::<MODES, MODES>(4, 4) + prior_information;
        let mut cross: SMatrix<f64, MODES, 4> = hessian.fixed_view::<MODES, 4>(4, 0).into_owned();
        let mut reduced: Vector6<f64> = gradient.fixed_rows::<MODES>(4) + prior_gradient;
        for j in 0..MODES {
            block[(j, j)] += damping * self.diagonal[j].max(MIN_DIAGONAL) + MIN_INFORMATION;
        }
        for j in (0..MODES).filter(|j| self.held[*j]) {
            block.row_mut(j).fill(0.0);
            block.column_mut(j).fill(0.0);
            block[(j, j)] = 1.0;
            cross.row_mut(j).fill(0.0);
            reduced[j] = 0.0;
        }
        let factor: Cholesky<f64, Const<MODES>> = Cholesky::new(block)?;
        self.gain = -factor.solve(&cross);
        self.offset = -factor.solve(&reduced);
        self.inverse = factor.inverse();
        for j in (0..MODES).filter(|j| self.held[*j]) {
            self.inverse[(j, j)] = 0.0;
        }
        *camera_hessian += hessian.fixed_view::<4, 4>(0, 0) + cross.tr_mul(&self.gain);
        *camera_gradient += gradient.fixed_rows::<4>(0) + cross.tr_mul(&self.offset);
        Some(())
    }

    /// Step of (camera, shape) that belongs to a camera step.
    pub fn shared_step(&self, camera: &Vector4<f64>) -> SVector<f64, SHARED> {
        let shape = self.gain * camera + self.offset;
        SVector::from_fn(|i, _| if i < 4 { camera[i] } else { shape[i - 4] })
    }

    /// Covariance of (camera, shape) from that of the camera.
    pub fn shared_covariance(&self, camera: &Matrix4<f64>) -> SMatrix<f64, SHARED, SHARED> {
        let cross = self.gain * camera;
        let mut joint = SMatrix::<f64, SHARED, SHARED>::zeros();
        joint.fixed_view_mut::<4, 4>(0, 0).copy_from(camera);
        joint.fixed_view_mut::<MODES, 4>(4, 0).copy_from(&cross);
        joint.fixed_view_mut::<4, MODES>(0, 4).copy_from(&cross.transpose());
        joint.fixed_view_mut::<MODES, MODES>(4, 4).copy_from(&(self.inverse + cross * self.gain.transpose()));
        joint
    }
}
