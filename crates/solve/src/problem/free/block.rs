//! One free car's normal equations.

use nalgebra::{Cholesky, Const, Matrix4, Matrix6, SMatrix, SVector, Vector4, Vector6};
use roadplane_base::{MODES, Shape};

use crate::linear::gram::MIN_INFORMATION;
use crate::model::free::Row;
use crate::model::latent::body_types::Gaussian;

pub(crate) type CarMatrix = SMatrix<f64, 12, 12>;
pub(crate) type CarVector = SVector<f64, 12>;

/// Normal equations of a car over (camera, shape, pose), and how it follows the camera once it is eliminated.
#[derive(Clone)]
pub(super) struct Block {
    pub sum: [[f64; 16]; 16],
    pub gradient: [f64; 16],
    pub held: [bool; MODES],
    pub gain: SMatrix<f64, 12, 4>,
    pub offset: CarVector,
    pub inverse: CarMatrix,
}

impl Block {
    /// Information on the shape and gradient of the cost, but for the shape's prior; pose eliminated.
    pub fn of_shape(&self, prior: &Gaussian<MODES>, shape: &Shape) -> Option<(Matrix6<f64>, Vector6<f64>)> {
        let part = |row: usize, column: usize| Matrix6::from_fn(|i, j| self.sum[row + i][column + j]);
        let gradient = |from: usize| Vector6::from_fn(|i, _| self.gradient[from + i]);
        let (shape_at, pose_at) = (4, 4 + MODES);
        let pose = (part(pose_at, pose_at) + Matrix6::identity() * MIN_INFORMATION).cholesky()?;
        let cross = part(shape_at, pose_at);
        let information =
            part(shape_at, shape_at) - prior.information - cross * pose.solve(&cross.transpose());
        let gradient = gradient(shape_at) - prior.gradient(shape) - cross * pose.solve(&gradient(pose_at));
        Some((information, gradient))
    }

    /// Adds a row, its residual and weight.
    pub fn add(&mut self, row: &Row, residual: f64, weight: f64) {
        for (a, sums) in self.sum.iter_mut().enumerate() {
            let scaled = weight * row[a];
            for (sum, entry) in sums.iter_mut().zip(row) {
                *sum += scaled * entry;
            }
        }
        for (sum, entry) in self.gradient.iter_mut().zip(row) {
            *sum += weight * residual * entry;
        }
    }

    /// Eliminates the car; adds what remains to the camera's equations.
    pub fn eliminate(
        &mut self,
        damping: f64,
        hessian: &mut Matrix4<f64>,
        gradient: &mut Vector4<f64>,
    ) -> Option<()> {
        let mut own = CarMatrix::from_fn(|i, j| self.sum[4 + i][4 + j]);
        let mut cross = SMatrix::<f64, 12, 4>::from_fn(|i, j| self.sum[4 + i][j]);
        let mut reduced = CarVector::from_fn(|i, _| self.gradient[4 + i]);
        for i in 0..12 {
            own[(i, i)] += damping * own[(i, i)].max(1e-9) + MIN_INFORMATION;
        }
        for j in (0..MODES).filter(|j| self.held[*j]) {
            own.row_mut(j).fill(0.0);
            own.column_mut(j).fill(0.0);
            own[(j, j)] = 1.0;
            cross.row_mut(j).fill(0.0);
            reduced[j] = 0.0;
        }
        let factor: Cholesky<f64, Const<12>> = Cholesky::new(own)?;
        self.gain = -factor.solve(&cross);
        self.offset = -factor.solve(&reduced);
        self.inverse = factor.inverse();
        for j in (0..MODES).filter(|j| self.held[*j]) {
            self.inverse[(j, j)] = 0.0;
        }
        *hessian += Matrix4::from_fn(|i, j| self.sum[i][j]) + cross.tr_mul(&self.gain);
        *gradient += Vector4::from_fn(|i, _| self.gradient[i]) + cross.tr_mul(&self.offset);
        Some(())
    }
}
