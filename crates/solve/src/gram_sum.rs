//! `Σ rowᵀ row` over a view's rows: Hessian and gradient at once, since the last column is the residual.
//!
//! Tiles of 2 × N entries are summed in registers, lane by lane; lanes are added at the end. With AVX2 by its instructions: left
//! to itself the compiler takes columns for lanes and shuffles. Both ways add in the same order, so bits are the same.

use crate::arrow::{Gram, RESIDUAL};
use crate::lanes::Lanes;

/// Columns of a row: unknowns and residual.
pub(crate) const WIDTH: usize = RESIDUAL + 1;

/// Rows of four keypoints: both coordinates.
pub(crate) type Rows = [[Lanes; WIDTH]; 2];

/// Sets the upper triangle.
pub(crate) fn accumulate(packs: &[Rows], gram: &mut Gram) {
    for (i, j, width) in TILES {
        match width {
            4 => tile::<4>(packs, gram, i, j),
            _ => tile::<2>(packs, gram, i, j),
        }
    }
}

/// The same.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
pub(crate) fn accumulate_avx2(packs: &[Rows], gram: &mut Gram) {
    for (i, j, width) in TILES {
        match width {
            4 => tile_avx2::<4>(packs, gram, i, j),
            _ => tile_avx2::<2>(packs, gram, i, j),
        }
    }
}

/// First row, first column, columns.
const TILES: [(usize, usize, usize); 16] = [
    (0, 0, 4),
    (0, 4, 4),
    (0, 8, 4),
    (0, 12, 2),
    (2, 2, 4),
    (2, 6, 4),
    (2, 10, 4),
    (4, 4, 4),
    (4, 8, 4),
    (4, 12, 2),
    (6, 6, 4),
    (6, 10, 4),
    (8, 8, 4),
    (8, 12, 2),
    (10, 10, 4),
    (12, 12, 2),
];

fn tile<const N: usize>(packs: &[Rows], gram: &mut Gram, i: usize, j: usize) {
    let mut sums = [[Lanes::default(); N]; 2];
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
fn tile_avx2<const N: usize>(packs: &[Rows], gram: &mut Gram, i: usize, j: usize) {
    use std::arch::x86_64::{
        _mm_add_pd, _mm_cvtsd_f64, _mm_unpackhi_pd, _mm256_add_pd, _mm256_castpd256_pd128,
        _mm256_extractf128_pd, _mm256_mul_pd, _mm256_setr_pd, _mm256_setzero_pd,
    };
    let mut sums = [[_mm256_setzero_pd(); N]; 2];
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

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_synth::Rng;

    #[test]
    fn sums_are_those_of_the_products_and_the_same_bits_both_ways() {
        let mut rng = Rng::new(3);
        let packs: Vec<Rows> = (0..9)
            .map(|_| [(); 2].map(|()| [(); WIDTH].map(|()| Lanes([(); 4].map(|()| rng.normal())))))
            .collect();
        let mut gram = Gram::zeros();
        accumulate(&packs, &mut gram);
        for i in 0..RESIDUAL {
            for j in i..WIDTH {
                let products = packs
                    .iter()
                    .flatten()
                    .map(|row| row[i].0.iter().zip(row[j].0).map(|(a, b)| a * b).sum::<f64>());
                let sum: f64 = products.sum();
                assert!((gram.rows[i][j] - sum).abs() < 1e-12, "({i}, {j})");
            }
        }
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            let mut other = Gram::zeros();
            // SAFETY: the processor has AVX2.
            #[allow(unsafe_code)]
            unsafe {
                accumulate_avx2(&packs, &mut other);
            };
            for i in 0..RESIDUAL {
                assert_eq!(gram.rows[i][i..WIDTH], other.rows[i][i..WIDTH]);
            }
        }
    }
}
