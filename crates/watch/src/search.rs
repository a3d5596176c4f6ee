//! Finds the similarity transform (shift, scale, rotation) between two pictures of one scene without an initial guess.
//!
//! Each block of one picture is searched for over a wide area of the other picture. The result is the transform that
//! fits most blocks.

use nalgebra::Vector2;
use roadplane_base::Similarity;

use crate::alignment::Alignment;
use crate::level::{Level, resampled};

/// Largest number of blocks that are searched for in the other picture.
const BLOCKS: usize = 60;
/// Side of a block, px. The search halves the reduced picture once more, and these are pixels of the halved picture.
const SIDE: usize = 8;
/// Largest shift of a block that the search covers, px of the halved picture.
const REACH: i64 = 24;
/// Smallest correlation coefficient of a block with its match.
const FOUND: f64 = 0.8;
/// Largest distance between an agreeing block's match and the position that the transform predicts, px of the reduced
/// picture at half its size.
const NEAR: f64 = 1.5;
/// Smallest share of the blocks that must agree with the transform.
const MIN_SHARE: f64 = 0.3;
/// Smallest number of blocks that must agree with the transform.
const MIN_BLOCKS: usize = 6;
/// Number of rounds that refine the result.
const REFINEMENTS: usize = 3;

/// Finds the similarity transform from the reference to a picture, px of the reduced picture.
///
/// `picture` is smoothed and has the size of the reference. Returns `None` if no transform fits enough blocks, because
/// the picture shows another scene.
pub(crate) fn search(reference: &Level, picture: &[f32]) -> Option<Similarity> {
    let (width, height) = reference.size();
    let from = Half::of(reference.values(), width, height);
    let to = Half::of(picture, width, height);
    let blocks = reference.best_blocks(BLOCKS);
    let pairs: Vec<(Vector2<f64>, Vector2<f64>)> =
        blocks.iter().filter_map(|&(x, y)| found(&from, &to, x / 2, y / 2)).collect();
    let enough = MIN_BLOCKS.max((MIN_SHARE * blocks.len() as f64).ceil() as usize);
    let mut best: Vec<(Vector2<f64>, Vector2<f64>)> = Vec::new();
    for (i, a) in pairs.iter().enumerate() {
        for b in &pairs[i + 1..] {
            // Neighbouring blocks determine scale and roll badly.
            if (a.0 - b.0).norm() < 3.0 * SIDE as f64 {
                continue;
            }
            let Some(proposal) = Similarity::fit(&[*a, *b]) else { continue };
            if proposal.log_scale().abs() > 0.5 {
                continue;
            }
            let along: Vec<_> =
                pairs.iter().filter(|(p, q)| (proposal.apply(p) - q).norm() < NEAR).copied().collect();
            if along.len() > best.len() {
                best = along;
            }
        }
    }
    if best.len() < enough {
        return None;
    }
    let doubled: Vec<_> = best.iter().map(|(p, q)| (p * 2.0, q * 2.0)).collect();
    Similarity::fit(&doubled)
}

/// Refines a transform from [`search`] to a fraction of a pixel. In each round, the picture is transformed back and
/// aligned with the reference.
pub(crate) fn refined(reference: &Level, picture: &[f32], found: &Similarity) -> Similarity {
    let (width, height) = reference.size();
    let middle = Vector2::new(width as f64, height as f64) / 2.0;
    let mut carried = *found;
    for _ in 0..REFINEMENTS {
        // Points outside the picture get zero.
        let back = resampled(picture, (width, height), |point| carried.apply(&point), |_| 0.0);
        let Some(rest) = Alignment::of(&reference.measured(&back, [0, 0])) else { break };
        let pairs = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(u, v)| {
            let point = Vector2::new(u * width as f64, v * height as f64);
            (point, carried.apply(&(point + rest.at(&(point - middle)))))
        });
        let Some(next) = Similarity::fit(&pairs) else { break };
        carried = next;
    }
    carried
}

struct Half {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Half {
    fn of(values: &[f32], width: usize, height: usize) -> Self {
        let (half_width, half_height) = (width / 2, height / 2);
        let mut half = Vec::with_capacity(half_width * half_height);
        for y in 0..half_height {
            let (upper, lower) = (&values[2 * y * width..], &values[(2 * y + 1) * width..]);
            half.extend(
                (0..half_width)
                    .map(|x| 0.25 * (upper[2 * x] + upper[2 * x + 1] + lower[2 * x] + lower[2 * x + 1])),
            );
        }
        Self { width: half_width, height: half_height, values: half }
    }

    fn block(&self, x: usize, y: usize) -> impl Iterator<Item = f64> + '_ {
        (y..y + SIDE).flat_map(move |row| &self.values[row * self.width + x..][..SIDE]).map(|v| f64::from(*v))
    }
}

/// Returns the centre of the block at (x, y) and the centre of its best match, px of the halved pictures. Returns
/// `None` if no match correlates well enough.
fn found(from: &Half, to: &Half, x: usize, y: usize) -> Option<(Vector2<f64>, Vector2<f64>)> {
    if x + SIDE > from.width || y + SIDE > from.height {
        return None;
    }
    let count = (SIDE * SIDE) as f64;
    let mean = from.block(x, y).sum::<f64>() / count;
    let pattern: Vec<f64> = from.block(x, y).map(|v| v - mean).collect();
    let norm = pattern.iter().map(|v| v * v).sum::<f64>().sqrt();
    let correlation = |x: usize, y: usize| {
        let (mut sum, mut squares, mut dot) = (0.0, 0.0, 0.0);
        for (value, pattern) in to.block(x, y).zip(&pattern) {
            sum += value;
            squares += value * value;
            dot += value * pattern;
        }
        let spread = (squares - sum * sum / count).max(0.0).sqrt();
        if spread > 1.0 { dot / (norm * spread) } else { 0.0 }
    };
    let span = |at: usize, length: usize| {
        let at = at as i64;
        let last = (length - SIDE) as i64;
        ((at - REACH).max(0) as usize)..=((at + REACH).min(last) as usize)
    };
    let mut best = (FOUND, None);
    for v in span(y, to.height) {
        for u in span(x, to.width) {
            let here = correlation(u, v);
            if here > best.0 {
                best = (here, Some((u, v)));
            }
        }
    }
    let centre = |x: usize, y: usize| Vector2::new(x as f64, y as f64).add_scalar(SIDE as f64 / 2.0);
    best.1.map(|(u, v)| (centre(x, y), centre(u, v)))
}
