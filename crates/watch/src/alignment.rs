//! Fits one similarity transform (shift, scale, rotation) of the whole picture to the measured shifts of its blocks.

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{Similarity, median};

use crate::level::BlockShift;

/// Smallest number of blocks that must agree with an alignment.
const MIN_AGREEING: usize = 6;
/// Smallest share of the trusted blocks that must agree with an alignment. It is small because traffic may cover the
/// other blocks.
const MIN_SHARE: f64 = 0.08;
/// Largest difference between the measured shift of an agreeing block and the shift that the alignment predicts there,
/// px of the reduced picture.
const AGREES: f64 = 0.35;
/// Number of reweighted least-squares rounds.
const ROUNDS: usize = 6;

/// Displacement of a picture against a reference picture: a shift, a change of scale and a rotation.
///
/// Let `p` be a point of the reference, px of the reduced picture from its middle. In the picture, this point lies at
/// `p + shift + log_scale · p + roll · p⊥`. Here `p⊥` is `p` turned by 90°: (−y, x).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// Shift, px of the reduced picture.
    pub shift: Vector2<f64>,
    /// Natural logarithm of the scale factor; it is positive if the scene appears larger than in the reference.
    pub log_scale: f64,
    /// Rotation about the optical axis, rad; clockwise in the picture is positive.
    pub roll: f64,
}

impl Alignment {
    /// Fits an alignment to the shifts of the blocks. Returns `None` if too few blocks agree with it.
    pub(crate) fn of(blocks: &[BlockShift]) -> Option<Self> {
        let measured: Vec<(Vector2<f64>, Vector2<f64>)> = blocks
            .iter()
            .filter(|block| block.is_trusted)
            .filter_map(|b| Some((b.centre, b.shift?)))
            .collect();
        let count = blocks.iter().filter(|block| block.is_trusted).count() as f64;
        let enough = MIN_AGREEING.max((MIN_SHARE * count).ceil() as usize);
        if measured.len() < enough {
            return None;
        }
        let axis =
            |axis: usize| median(&mut measured.iter().map(|(_, shift)| shift[axis]).collect::<Vec<_>>());
        let mut model = Vector4::new(axis(0)?, axis(1)?, 0.0, 0.0);
        let mut reach = 2.0 * AGREES;
        for _ in 0..ROUNDS {
            let mut normal = Matrix4::zeros();
            let mut right = Vector4::zeros();
            for (centre, shift) in &measured {
                let away = (shift - displaced(&model, centre)).norm();
                if away > reach {
                    continue;
                }
                let weight = (1.0 - (away / reach).powi(2)).powi(2);
                for (row, value) in rows(centre).iter().zip([shift.x, shift.y]) {
                    normal += row * row.transpose() * weight;
                    right += row * value * weight;
                }
            }
            // This weak prior keeps scale and roll near zero if all blocks lie close together and cannot determine
            // them.
            normal[(2, 2)] += 1e3;
            normal[(3, 3)] += 1e3;
            model = normal.cholesky()?.solve(&right);
            reach = (reach * 0.8).max(AGREES);
        }
        let agreeing = measured.iter().filter(|(p, d)| (d - displaced(&model, p)).norm() <= AGREES).count();
        (agreeing >= enough).then(|| Self { shift: model.xy(), log_scale: model[2], roll: model[3] })
    }

    /// Converts a similarity transform between two pictures, px. `middle` is the middle of the pictures in the same
    /// coordinates.
    pub(crate) fn from_similarity(carried: &Similarity, middle: &Vector2<f64>) -> Self {
        let shift = carried.apply(middle) - middle;
        Self { shift, log_scale: carried.log_scale(), roll: carried.turn() }
    }

    /// Returns the alignment that results from this alignment, followed by `next`, to first order.
    pub(crate) fn then(&self, next: &Self) -> Self {
        Self {
            shift: self.shift + next.at(&self.shift),
            log_scale: self.log_scale + next.log_scale,
            roll: self.roll + next.roll,
        }
    }

    /// Returns the displacement, px, of a point that is given in px from the picture's middle.
    pub(crate) fn at(&self, point: &Vector2<f64>) -> Vector2<f64> {
        displaced(&Vector4::new(self.shift.x, self.shift.y, self.log_scale, self.roll), point)
    }

    /// Returns the root mean square displacement of all points of a picture of `width` × `height` px, in px of the
    /// reduced picture.
    #[must_use]
    pub fn displacement(&self, width: usize, height: usize) -> f64 {
        let reach = ((width * width + height * height) as f64 / 12.0).sqrt();
        self.shift.norm().hypot(self.log_scale.hypot(self.roll) * reach)
    }
}

fn rows(centre: &Vector2<f64>) -> [Vector4<f64>; 2] {
    [Vector4::new(1.0, 0.0, centre.x, -centre.y), Vector4::new(0.0, 1.0, centre.y, centre.x)]
}

fn displaced(model: &Vector4<f64>, centre: &Vector2<f64>) -> Vector2<f64> {
    let [x, y] = rows(centre);
    Vector2::new(x.dot(model), y.dot(model))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_majority_of_blocks_decides_and_outliers_are_ignored() {
        let mut blocks = Vec::new();
        for y in -4..=4 {
            for x in -7..=7 {
                let centre = Vector2::new(f64::from(x) * 16.0, f64::from(y) * 16.0);
                let own = Vector2::new(0.4 - 0.003 * centre.x, -0.2 - 0.003 * centre.y);
                // A lorry covers the half with negative x. The blocks in this half return wrong shifts or no shift.
                let shift = match (x < 0, (x + y) % 2) {
                    (true, 0) => None,
                    (true, _) => Some(Vector2::new(f64::from(x * y % 3) * 0.5, 1.0)),
                    (false, _) => Some(own),
                };
                blocks.push(BlockShift { centre, shift, is_trusted: true });
            }
        }
        let found = Alignment::of(&blocks).unwrap();
        assert!((found.shift - Vector2::new(0.4, -0.2)).norm() < 0.02, "{found:?}");
        assert!((found.log_scale + 0.003).abs() < 2e-4 && found.roll.abs() < 2e-4, "{found:?}");
        blocks.iter_mut().for_each(|block| block.shift = None);
        assert_eq!(Alignment::of(&blocks), None);
    }
}
