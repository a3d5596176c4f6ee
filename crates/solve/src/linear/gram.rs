//! `Σ rowᵀ row` over a view's rows: Hessian and gradient at once, since the last column is the residual.
//!
//! Tiles of 2 × W entries are summed in registers, lane by lane, and lanes are added at the end. AVX2 is used by
//! explicit instructions, because the compiler alone uses columns as lanes and shuffles them. Both versions add in the
//! same order, so their bits are equal.

use roadplane_base::ALL_MODES;

use crate::linear::lanes::Lanes;

/// Largest number of unknowns of a view: position and heading on the plane, all modes, the camera.
pub(crate) const MAX_UNKNOWNS: usize = 3 + ALL_MODES + 4;
/// Number of columns of a row with all modes, rounded up to whole SIMD registers.
pub(crate) const MAX_WIDTH: usize = (MAX_UNKNOWNS + 1).next_multiple_of(4);

/// Least information on a pose coordinate. An unobserved one gets an sd of 1e6 instead of a singular matrix.
pub(crate) const MIN_INFORMATION: f64 = 1e-12;

/// A row with room for all modes; entries left of the diagonal are not used.
pub(crate) type Row = [f64; MAX_WIDTH];

/// Least diagonal entry for the damping, so that unobserved directions are damped too.
const MIN_DIAGONAL: f64 = 1e-9;

/// One view's part of Hessian and gradient: N unknowns of the pose, M modes and the camera, in this order.
#[derive(Clone, Debug)]
#[repr(align(32))]
pub(crate) struct Gram<const N: usize, const M: usize> {
    pub rows: [Row; MAX_UNKNOWNS],
}

impl<const N: usize, const M: usize> Gram<N, M> {
    /// First column of the camera.
    pub const CAMERA: usize = N + M;
    /// Column of the residual, and so of the gradient.
    pub const RESIDUAL: usize = Self::CAMERA + 4;

    pub const fn zeros() -> Self {
        Self { rows: [[0.0; MAX_WIDTH]; MAX_UNKNOWNS] }
    }

    /// Returns a diagonal entry of the Hessian.
    pub fn diagonal(&self, i: usize) -> f64 {
        self.rows[i][i]
    }

    /// Returns an entry of the gradient.
    pub fn gradient(&self, i: usize) -> f64 {
        self.rows[i][Self::RESIDUAL]
    }

    /// Returns the Hessian times x.
    pub fn times(&self, x: &[f64]) -> Row {
        let entry = |i: usize, j: usize| self.rows[i.min(j)][i.max(j)];
        let row = |i: usize| x[..Self::RESIDUAL].iter().enumerate().map(|(j, x)| entry(i, j) * x).sum();
        std::array::from_fn(|i| if i < Self::RESIDUAL { row(i) } else { 0.0 })
    }

    /// Damps an unknown in proportion to a given diagonal entry.
    pub fn damp(&mut self, i: usize, damping: f64, diagonal: f64) {
        self.rows[i][i] += damping * diagonal.max(MIN_DIAGONAL) + MIN_INFORMATION;
    }

    /// Eliminates unknowns `from` … `to` − 1. Returns `None` if their block is not positive definite.
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

    /// Adds the product of a single row with itself.
    pub fn add(&mut self, row: &Row) {
        for (sums, factor) in self.rows.iter_mut().zip(row).take(Self::RESIDUAL) {
            for (sum, entry) in sums.iter_mut().zip(row) {
                *sum += factor * entry;
            }
        }
    }

    /// Adds the rows of shape and camera of another view.
    pub fn add_shape_and_camera(&mut self, other: &Self) {
        for (sum, row) in self.rows.iter_mut().zip(&other.rows).take(Self::RESIDUAL).skip(N) {
            for (sum, entry) in sum.iter_mut().zip(row) {
                *sum += entry;
            }
        }
    }
}

/// Rows of four keypoints, for both coordinates, with room for all modes.
pub(crate) type Rows = [[Lanes; MAX_WIDTH]; 2];

/// Computes the upper triangle.
pub(crate) fn accumulate<const N: usize, const M: usize>(packs: &[Rows], gram: &mut Gram<N, M>) {
    for (i, j, width) in tiles(Gram::<N, M>::RESIDUAL) {
        match width {
            4 => tile::<N, M, 4>(packs, gram, i, j),
            _ => tile::<N, M, 2>(packs, gram, i, j),
        }
    }
}

/// Computes the upper triangle with AVX2 instructions.
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

/// Returns the tiles that cover the upper triangle and the residual: first row, first column, number of columns.
///
/// A tile has 4 columns, or 2 at the right end.
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
