//! Decodes the net's outputs into boxes.
//!
//! The head is that of the generalised focal loss (arXiv 2006.04388). Each distance from a cell's centre to a side of
//! the box is the mean of a distribution over 0…10 cells.

use ndarray::ArrayView3;
use roadplane_base::VehicleClass;

/// Classes in the order of the net's scores.
pub(crate) const CLASSES: [VehicleClass; 3] = [VehicleClass::Car, VehicleClass::Truck, VehicleClass::Bus];
/// Number of bins of a distance's distribution.
pub(crate) const BINS: usize = 11;

/// A box before merging, from the picture's top-left corner in px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Candidate {
    pub bbox: [f64; 4],
    pub score: f64,
    pub class: VehicleClass,
    /// Index of the pass that found the box.
    pub pass: usize,
}

/// Returns the boxes of all cells of one level whose best score is at least `min_score`, in px from the corner of the
/// net's input.
///
/// `scores` is [3, rows, columns]. `bins` is [44, rows, columns]: left, top, right, bottom, with 11 logits each.
pub(crate) fn candidates(
    scores: &ArrayView3<'_, f32>,
    bins: &ArrayView3<'_, f32>,
    stride_px: f64,
    min_score: f64,
    pass: usize,
) -> Vec<Candidate> {
    let (classes, rows, columns) = scores.dim();
    let mut found = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let mut best = (0, f32::MIN);
            for class in 0..classes {
                let score = scores[[class, row, column]];
                if score > best.1 {
                    best = (class, score);
                }
            }
            let score = f64::from(best.1);
            if score < min_score {
                continue;
            }
            let distance = |side: usize| {
                stride_px
                    * expected_bin((0..BINS).map(|bin| f64::from(bins[[side * BINS + bin, row, column]])))
            };
            let (x, y) = ((column as f64 + 0.5) * stride_px, (row as f64 + 0.5) * stride_px);
            let bbox = [x - distance(0), y - distance(1), x + distance(2), y + distance(3)];
            let class = CLASSES.get(best.0).copied().unwrap_or(VehicleClass::Car);
            found.push(Candidate { bbox, score, class, pass });
        }
    }
    found
}

/// Returns the mean of the softmax over 0, 1, 2, …
fn expected_bin(logits: impl Iterator<Item = f64> + Clone) -> f64 {
    let highest = logits.clone().fold(f64::MIN, f64::max);
    let (sum, moment) = logits.enumerate().fold((0.0, 0.0), |(sum, moment), (bin, logit)| {
        let weight = (logit - highest).exp();
        (sum + weight, moment + weight * bin as f64)
    });
    moment / sum
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    #[test]
    fn a_cell_becomes_its_box() {
        let mut scores = Array3::<f32>::zeros((3, 4, 5));
        let mut bins = Array3::<f32>::zeros((44, 4, 5));
        scores[[1, 2, 3]] = 0.9;
        // The distributions are certain of 1, 2, 3 and 4 cells to the left, top, right and bottom.
        for side in 0..4 {
            bins[[side * BINS + side + 1, 2, 3]] = 50.0;
        }
        let found = candidates(&scores.view(), &bins.view(), 8.0, 0.5, 7);
        let [only] = found[..] else { panic!("{found:?}") };
        let (x, y) = (3.5 * 8.0, 2.5 * 8.0);
        for (found, expected) in only.bbox.iter().zip([x - 8.0, y - 16.0, x + 24.0, y + 32.0]) {
            assert!((found - expected).abs() < 1e-6);
        }
        assert_eq!((only.class, only.pass), (VehicleClass::Truck, 7));
        assert!((expected_bin([0.0; BINS].into_iter()) - 5.0).abs() < 1e-12);
    }
}
