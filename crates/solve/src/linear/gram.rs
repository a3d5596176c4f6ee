//! Normal equations of one view: the sum `Σ rowᵀ row` over the rows of its whitened Jacobian.
//!
//! The last column of a row is the residual. So the sum contains the Hessian and, in its last column, the gradient.
//!
//! The sum is computed in tiles of 2 rows and W columns, each in SIMD registers. A register has one lane for each of
//! four keypoints, and its lanes are added at the end. The AVX2 version uses explicit instructions, because the
//! compiler by itself treats columns as lanes and shuffles them. The AVX2 version and the portable version add in the
//! same order, so their results are equal to the last bit.

use roadplane_base::ALL_MODES;

use crate::linear::lanes::Lanes;

/// Largest number of unknowns of a view: pose on the plane (3), all shape modes, camera (4).
pub(crate) const MAX_UNKNOWNS: usize = 3 + ALL_MODES + 4;
/// Largest number of columns of a row (all unknowns and the residual), rounded up to whole SIMD registers.
pub(crate) const MAX_WIDTH: usize = (MAX_UNKNOWNS + 1).next_multiple_of(4);

/// Information that is added to each unknown of a car.
///
/// The addition keeps the Hessian invertible: an unobserved pose coordinate gets an sd of 1e6.
pub(crate) const MIN_INFORMATION: f64 = 1e-12;

/// A row of the normal equations with room for all shape modes; entries left of the diagonal are not used.
pub(crate) type Row = [f64; MAX_WIDTH];

/// Lower limit of the diagonal entry that scales the damping, so that unobserved directions are damped too.
const MIN_DIAGONAL: f64 = 1e-9;

/// Hessian and gradient of one view's cost.
///
/// The unknowns are the pose (N), the shape modes (M) and the camera (4), in this order.
#[derive(Clone, Debug)]
#[repr(align(32))]
pub(crate) struct Gram<const N: usize, const M: usize> {
    pub rows: [Row; MAX_UNKNOWNS],
}

impl<const N: usize, const M: usize> Gram<N, M> {
    /// Index of the camera's first column.
    pub const CAMERA: usize = N + M;
    /// Index of the column of the residual. After the summation, this column contains the gradient.
    pub const RESIDUAL: usize = Self::CAMERA + 4;

    pub const fn zeros() -> Self {
        Self { rows: [[0.0; MAX_WIDTH]; MAX_UNKNOWNS] }
    }

    /// Returns the i-th diagonal entry of the Hessian.
    pub fn diagonal(&self, i: usize) -> f64 {
        self.rows[i][i]
    }

    /// Returns the i-th entry of the gradient.
    pub fn gradient(&self, i: usize) -> f64 {
        self.rows[i][Self::RESIDUAL]
    }

    /// Returns the product of the Hessian and the vector x.
    pub fn times(&self, x: &[f64]) -> Row {
        let entry = |i: usize, j: usize| self.rows[i.min(j)][i.max(j)];
        let row = |i: usize| x[..Self::RESIDUAL].iter().enumerate().map(|(j, x)| entry(i, j) * x).sum();
        std::array::from_fn(|i| if i < Self::RESIDUAL { row(i) } else { 0.0 })
    }

    /// Adds damping to the i-th diagonal entry, in proportion to `diagonal`.
    pub fn damp(&mut self, i: usize, damping: f64, diagonal: f64) {
        self.rows[i][i] += damping * diagonal.max(MIN_DIAGONAL) + MIN_INFORMATION;
    }

    /// Eliminates the unknowns `from` to `to` − 1. Returns `None` if their block is not positive definite.
    #[inline(always)]
    pub fn eliminate(&mut self, from: usize, to: usize) -> Option<()> {
        for i in from..to {
            let own = self.rows[i];
            let inverse = 1.0 / own[i];
            if !(inverse > 0.0 && inverse.is_finite()) {
                return None;
            }
            for (j, row) in self.rows[..Self::RESIDUAL].iter_mut().enumerate().skip(i + 1) {
                let factor = own[j] * inverse;
                for register in j / 4..(Self::RESIDUAL + 1).div_ceil(4) {
                    for c in 4 * register..4 * register + 4 {
                        row[c] -= factor * own[c];
                    }
                }
            }
        }
        Some(())
    }

    /// Adds the outer product `rowᵀ row` of a single row.
    pub fn add(&mut self, row: &Row) {
        for (sums, factor) in self.rows.iter_mut().zip(row).take(Self::RESIDUAL) {
            for (sum, entry) in sums.iter_mut().zip(row) {
                *sum += factor * entry;
            }
        }
    }

    /// Adds the rows of shape and camera from another view's equations.
    pub fn add_shape_and_camera(&mut self, other: &Self) {
        for (sum, row) in self.rows.iter_mut().zip(&other.rows).take(Self::RESIDUAL).skip(N) {
            for (sum, entry) in sum.iter_mut().zip(row) {
                *sum += entry;
            }
        }
    }
}

/// Jacobian rows of four keypoints, side by side: one row per pixel coordinate, with room for all shape modes.
pub(crate) type Rows = [[Lanes; MAX_WIDTH]; 2];

/// Computes the upper triangle of a view's Hessian, and its gradient, from its rows.
pub(crate) fn accumulate<const N: usize, const M: usize>(packs: &[Rows], gram: &mut Gram<N, M>) {
    for (i, j, width) in tiles(Gram::<N, M>::RESIDUAL) {
        match width {
            4 => tile::<N, M, 4>(packs, gram, i, j),
            _ => tile::<N, M, 2>(packs, gram, i, j),
        }
    }
}

/// Computes the same numbers as [`accumulate`], with AVX2 instructions.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
pub(crate) fn accumulate_avx2<const N: usize, const M: usize>(packs: &[Rows], gram: &mut Gram<N, M>) {
    for (i, j, width) in tiles(Gram::<N, M>::RESIDUAL) {
        match width {
            4 => tile_avx2::<N, M, 4>(packs, gram, i, j),
            _ => tile_avx2::<N, M, 2>(packs, gram, i, j),
        }
    }
}

/// Returns the tiles that cover the upper triangle and the residual's column.
///
/// Each tile is (first row, first column, number of columns). It has 2 rows and usually 4 columns. A tile at the right
/// end may have only 2 columns.
fn tiles(residual: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    let width = (residual + 1).next_multiple_of(2);
    let of_row = move |i: usize| (i..width).step_by(4).map(move |j| (i, j, (width - j).min(4)));
    (0..residual).step_by(2).flat_map(of_row)
}

fn tile<const N: usize, const M: usize, const W: usize>(
    packs: &[Rows],
    gram: &mut Gram<N, M>,
    i: usize,
    j: usize,
) {
    let mut sums = [[Lanes::default(); W]; 2];
    for row in packs.iter().flatten() {
        for (a, sums) in sums.iter_mut().enumerate() {
            for (b, sum) in sums.iter_mut().enumerate() {
                *sum += row[i + a] * row[j + b];
            }
        }
    }
    for (row, sums) in gram.rows.iter_mut().skip(i).zip(&sums) {
        for (entry, sum) in row[j..].iter_mut().zip(sums) {
            *entry = sum.sum();
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn tile_avx2<const N: usize, const M: usize, const W: usize>(
    packs: &[Rows],
    gram: &mut Gram<N, M>,
    i: usize,
    j: usize,
) {
    use std::arch::x86_64::{
        _mm_add_pd, _mm_cvtsd_f64, _mm_unpackhi_pd, _mm256_add_pd, _mm256_castpd256_pd128,
        _mm256_extractf128_pd, _mm256_mul_pd, _mm256_setr_pd, _mm256_setzero_pd,
    };
    let mut sums = [[_mm256_setzero_pd(); W]; 2];
    for row in packs.iter().flatten() {
        let load = |Lanes(l): Lanes| _mm256_setr_pd(l[0], l[1], l[2], l[3]);
        for (a, sums) in sums.iter_mut().enumerate() {
            for (b, sum) in sums.iter_mut().enumerate() {
                *sum = _mm256_add_pd(*sum, _mm256_mul_pd(load(row[i + a]), load(row[j + b])));
            }
        }
    }
    for (row, sums) in gram.rows.iter_mut().skip(i).zip(&sums) {
        for (entry, sum) in row[j..].iter_mut().zip(sums) {
            let pair = _mm_add_pd(_mm256_castpd256_pd128(*sum), _mm256_extractf128_pd::<1>(*sum));
            *entry = _mm_cvtsd_f64(_mm_add_pd(pair, _mm_unpackhi_pd(pair, pair)));
        }
    }
}
