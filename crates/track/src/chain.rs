//! Solves least squares over a chain of states, each coupled to its neighbours only. The normal equations are
//! block-tridiagonal, and the time is linear in the chain's length.

use nalgebra::{Matrix5, SMatrix, Vector5};

/// The rows of one state in a right-hand side with this number of columns.
pub(crate) type Columns<const COLUMNS: usize> = SMatrix<f64, 5, COLUMNS>;

/// The quadratic form `½ δᵀ H δ + gᵀ δ`, with the diagonal and upper blocks of H.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    /// Diagonal blocks of H, one per state.
    pub diagonal: Vec<Matrix5<f64>>,
    /// Upper blocks of H: `upper[i]` couples state i (rows) with state i + 1 (columns).
    pub upper: Vec<Matrix5<f64>>,
    /// The gradient g, one block per state.
    pub gradient: Vec<Vector5<f64>>,
}

impl Blocks {
    /// Creates a form of this many states in which all blocks are zero.
    pub(crate) fn zeros(states: usize) -> Self {
        Self {
            diagonal: vec![Matrix5::zeros(); states],
            upper: vec![Matrix5::zeros(); states.saturating_sub(1)],
            gradient: vec![Vector5::zeros(); states],
        }
    }

    /// Returns the inverted pivots `S_0 = D_0, S_i = D_i − U_{i−1}ᵀ S_{i−1}⁻¹ U_{i−1}`; `None` where H is not positive
    /// definite.
    fn inverse_pivots(&self, damping: f64) -> Option<Vec<Matrix5<f64>>> {
        let mut inverses: Vec<Matrix5<f64>> = Vec::with_capacity(self.diagonal.len());
        for (i, block) in self.diagonal.iter().enumerate() {
            let mut pivot = block + Matrix5::from_diagonal(&block.diagonal()) * damping;
            if let (Some(before), Some(upper)) = (inverses.last(), i.checked_sub(1).map(|i| self.upper[i])) {
                pivot -= upper.transpose() * before * upper;
            }
            inverses.push(((pivot + pivot.transpose()) / 2.0).cholesky()?.inverse());
        }
        Some(inverses)
    }

    /// Returns the step `−H⁻¹ g`, with the diagonal enlarged by the share `damping`.
    pub(crate) fn step(&self, damping: f64) -> Option<Vec<Vector5<f64>>> {
        self.solve(damping, self.gradient.iter().map(|g| -g).collect())
    }

    /// Returns `H⁻¹ r` for a right-hand side r, block by block, with the diagonal enlarged by the share `damping`.
    pub(crate) fn solve<const COLUMNS: usize>(
        &self,
        damping: f64,
        mut right: Vec<Columns<COLUMNS>>,
    ) -> Option<Vec<Columns<COLUMNS>>> {
        let inverses = self.inverse_pivots(damping)?;
        for i in 1..right.len() {
            let carried = self.upper[i - 1].transpose() * inverses[i - 1] * right[i - 1];
            right[i] -= carried;
        }
        for i in (0..right.len()).rev() {
            let coupled = right.get(i + 1).map_or_else(Columns::zeros, |next| self.upper[i] * next);
            right[i] = inverses[i] * (right[i] - coupled);
        }
        right.iter().all(|step| step.iter().all(|x| x.is_finite())).then_some(right)
    }

    /// Returns the diagonal blocks of H⁻¹: the covariance of each state, all others being uncertain.
    pub(crate) fn covariances(&self) -> Option<Vec<Matrix5<f64>>> {
        let mut covariances = self.inverse_pivots(0.0)?;
        for i in (0..covariances.len().saturating_sub(1)).rev() {
            let gain = covariances[i] * self.upper[i];
            let carried = gain * covariances[i + 1] * gain.transpose();
            covariances[i] += carried;
        }
        Some(covariances)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn agrees_with_the_dense_solution() {
        let states = 6;
        let mut blocks = Blocks::zeros(states);
        let noise = |i: usize, r: usize, c: usize| ((i * 25 + r * 5 + c) as f64 * 12.9898).sin();
        let mut dense = DMatrix::<f64>::zeros(5 * states, 5 * states);
        let mut gradient = DVector::<f64>::zeros(5 * states);
        for i in 0..states {
            let a = Matrix5::from_fn(|r, c| noise(i, r, c));
            blocks.diagonal[i] = a * a.transpose() + Matrix5::identity() * 4.0;
            blocks.gradient[i] = Vector5::from_fn(|r, _| noise(i + 50, r, 0));
            dense.fixed_view_mut::<5, 5>(5 * i, 5 * i).copy_from(&blocks.diagonal[i]);
            gradient.fixed_rows_mut::<5>(5 * i).copy_from(&blocks.gradient[i]);
            if i + 1 < states {
                blocks.upper[i] = Matrix5::from_fn(|r, c| 0.3 * noise(i + 9, r, c));
                dense.fixed_view_mut::<5, 5>(5 * i, 5 * i + 5).copy_from(&blocks.upper[i]);
                dense.fixed_view_mut::<5, 5>(5 * i + 5, 5 * i).copy_from(&blocks.upper[i].transpose());
            }
        }
        let inverse = dense.cholesky().unwrap().inverse();
        let step = -(&inverse * gradient);
        let ours = blocks.step(0.0).unwrap();
        let covariances = blocks.covariances().unwrap();
        for i in 0..states {
            assert!((ours[i] - step.fixed_rows::<5>(5 * i)).norm() < 1e-12);
            assert!((covariances[i] - inverse.fixed_view::<5, 5>(5 * i, 5 * i)).norm() < 1e-12);
        }
    }
}
