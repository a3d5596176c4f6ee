//! Decodes the net's outputs into boxes.
//!
//! The net has the output head of the generalised focal loss (arXiv 2006.04388). It gives the distances from a cell's
//! centre to the four sides of the box. Each distance is the mean of a distribution over 0…10 cells.

use ndarray::ArrayView3;
use roadplane_base::VehicleClass;

/// Vehicle classes in the order of the net's scores. A net may lack the last one.
pub(crate) const CLASSES: [VehicleClass; 4] = VehicleClass::ALL;
/// Smallest number of classes of a net.
pub(crate) const FEWEST_CLASSES: usize = 3;
/// Number of bins in the distribution of a distance: 0…10 cells.
pub(crate) const BINS: usize = 11;

/// A box before merging, in px from the picture's top-left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Candidate {
    pub bbox: [f64; 4],
    pub score: f64,
    pub class: VehicleClass,
}

/// Returns the boxes of one output level, in px from the top-left corner of the net's input. A cell gives a box if its
/// best score is at least `min_score`.
///
/// `scores` has the shape [classes, rows, columns]: one score for each class. `bins` has the shape [44, rows, columns]:
/// 11 logits for each of left, top, right, bottom.
pub(crate) fn candidates(
    scores: &ArrayView3<'_, f32>,
    bins: &ArrayView3<'_, f32>,
    stride_px: f64,
    min_score: f64,
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
            found.push(Candidate { bbox, score, class });
        }
    }
    found
}

/// Returns the mean bin number, where the bins 0, 1, 2, … have the probabilities softmax(`logits`).
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
        // The distributions put all weight on 1, 2, 3 and 4 cells to the left, top, right and bottom.
        for side in 0..4 {
            bins[[side * BINS + side + 1, 2, 3]] = 50.0;
        }
        let found = candidates(&scores.view(), &bins.view(), 8.0, 0.5);
        let [only] = found[..] else { panic!("{found:?}") };
        let (x, y) = (3.5 * 8.0, 2.5 * 8.0);
        for (found, expected) in only.bbox.iter().zip([x - 8.0, y - 16.0, x + 24.0, y + 32.0]) {
            assert!((found - expected).abs() < 1e-6);
        }
        assert_eq!(only.class, VehicleClass::Truck);
        assert!((expected_bin([0.0; BINS].into_iter()) - 5.0).abs() < 1e-12);
    }

    #[test]
    fn a_net_with_four_classes_finds_motorcycles() {
        let mut scores = Array3::<f32>::zeros((4, 2, 2));
        scores[[3, 1, 0]] = 0.8;
        let found = candidates(&scores.view(), &Array3::<f32>::zeros((44, 2, 2)).view(), 8.0, 0.5);
        assert_eq!(found.iter().map(|c| c.class).collect::<Vec<_>>(), [VehicleClass::Motorcycle]);
    }
}
