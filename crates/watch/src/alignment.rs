//! One similarity of the picture that most blocks agree on.

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{Similarity, median};

use crate::level::BlockShift;

/// Blocks that must agree for a verdict.
const MIN_AGREEING: usize = 6;
/// Share of the blocks with structure that must agree: traffic may cover all others.
const MIN_SHARE: f64 = 0.08;
/// A block agrees within this distance, px of the small picture.
const AGREES: f64 = 0.35;
const ROUNDS: usize = 6;

/// How a picture lies against the reference: what was at `p` (from the picture's middle) is at
/// `p + shift + log_scale · p + roll · p⊥`, small picture's px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// Shift, px.
    pub shift: Vector2<f64>,
    /// Logarithm of the growth.
    pub log_scale: f64,
    /// Turn about the optical axis, rad.
    pub roll: f64,
}

impl Alignment {
    /// From what blocks say; `None` where too few agree.
    pub(crate) fn of(blocks: &[BlockShift]) -> Option<Self> {
        let told: Vec<(Vector2<f64>, Vector2<f64>)> = blocks
            .iter()
            .filter(|block| block.has_a_say)
            .filter_map(|b| Some((b.centre, b.shift?)))
            .collect();
        let count = blocks.iter().filter(|block| block.has_a_say).count() as f64;
        let enough = MIN_AGREEING.max((MIN_SHARE * count).ceil() as usize);
        if told.len() < enough {
            return None;
        }
        let axis = |axis: usize| median(&mut told.iter().map(|(_, shift)| shift[axis]).collect::<Vec<_>>());
        let mut model = Vector4::new(axis(0)?, axis(1)?, 0.0, 0.0);
        let mut reach = 2.0 * AGREES;
        for _ in 0..ROUNDS {
            let mut normal = Matrix4::zeros();
            let mut right = Vector4::zeros();
            for (centre, shift) in &told {
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
            // Blocks that huddle together say nothing of scale and roll.
            normal[(2, 2)] += 1e3;
            normal[(3, 3)] += 1e3;
            model = normal.cholesky()?.solve(&right);
            reach = (reach * 0.8).max(AGREES);
        }
        let agreeing = told.iter().filter(|(p, d)| (d - displaced(&model, p)).norm() <= AGREES).count();
        (agreeing >= enough).then(|| Self { shift: model.xy(), log_scale: model[2], roll: model[3] })
    }

    /// Of a similarity between the pixels of pictures of this size.
    pub(crate) fn from_similarity(carried: &Similarity, width: usize, height: usize) -> Self {
        let middle = Vector2::new(width as f64, height as f64) / 2.0;
        let shift = carried.apply(&middle) - middle;
        Self { shift, log_scale: carried.log_scale(), roll: carried.turn() }
    }

    /// This one, and then another; to first order.
    pub(crate) fn then(&self, next: &Self) -> Self {
        Self {
            shift: self.shift + next.at(&self.shift),
            log_scale: self.log_scale + next.log_scale,
            roll: self.roll + next.roll,
        }
    }

    /// Displacement of what was at a point, px from the picture's middle.
    pub(crate) fn at(&self, point: &Vector2<f64>) -> Vector2<f64> {
        displaced(&Vector4::new(self.shift.x, self.shift.y, self.log_scale, self.roll), point)
    }

    /// Root mean square displacement over a picture of this size, px of the small picture.
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
    fn the_many_are_believed_and_strangers_are_not() {
        let mut blocks = Vec::new();
        for y in -4..=4 {
            for x in -7..=7 {
                let centre = Vector2::new(f64::from(x) * 16.0, f64::from(y) * 16.0);
                let own = Vector2::new(0.4 - 0.003 * centre.x, -0.2 - 0.003 * centre.y);
                // A lorry over the left half, which says nonsense or nothing.
                let shift = match (x < 0, (x + y) % 2) {
                    (true, 0) => None,
                    (true, _) => Some(Vector2::new(f64::from(x * y % 3) * 0.5, 1.0)),
                    (false, _) => Some(own),
                };
                blocks.push(BlockShift { centre, shift, has_a_say: true });
            }
        }
        let found = Alignment::of(&blocks).unwrap();
        assert!((found.shift - Vector2::new(0.4, -0.2)).norm() < 0.02, "{found:?}");
        assert!((found.log_scale + 0.003).abs() < 2e-4 && found.roll.abs() < 2e-4, "{found:?}");
        blocks.iter_mut().for_each(|block| block.shift = None);
        assert_eq!(Alignment::of(&blocks), None);
    }
}
