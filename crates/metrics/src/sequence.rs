//! What the tracking metrics work on: who was there in each frame and how alike each pair is.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::assign;

/// Similarity on the ground falls to 0 at this distance, m (Luiten et al. 2021 §5: `max(0, 1 − d / zero_distance)`).
pub const ZERO_DISTANCE_M: f64 = 4.0;

/// Slack of comparisons with a threshold, as the reference implementation has it.
pub(crate) const EPSILON: f64 = f64::EPSILON;

/// One frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SequenceFrame {
    /// Tracks of the truth in this frame.
    pub truth: Vec<u64>,
    /// Tracks of the result in this frame.
    pub found: Vec<u64>,
    /// How alike they are, 0–1: `similarity[i][j]` of `truth[i]` and `found[j]`.
    pub similarity: Vec<Vec<f64>>,
}

/// A clip, frame by frame.
pub type Sequence = Vec<SequenceFrame>;

impl SequenceFrame {
    /// From things with ids and any similarity.
    #[must_use]
    pub fn new<T>(truth: &[(u64, T)], found: &[(u64, T)], similarity: impl Fn(&T, &T) -> f64) -> Self {
        Self {
            truth: truth.iter().map(|(id, _)| *id).collect(),
            found: found.iter().map(|(id, _)| *id).collect(),
            similarity: truth
                .iter()
                .map(|(_, a)| found.iter().map(|(_, b)| similarity(a, b)).collect())
                .collect(),
        }
    }

    /// From positions on the ground, m.
    #[must_use]
    pub fn on_ground(truth: &[(u64, Vector2<f64>)], found: &[(u64, Vector2<f64>)]) -> Self {
        Self::new(truth, found, |a, b| ground_similarity((a - b).norm()))
    }

    /// Pairs (truth, found) at the greatest sum of scores; pairs whose score is 0 are not made.
    pub fn pairs(&self, score: impl Fn(usize, usize) -> f64) -> Vec<(usize, usize)> {
        // Scores are far below 1 where tracks seldom meet; the assignment rounds to 1e-6.
        let cost = |i: usize, j: usize| -1e3 * score(i, j);
        let found_of = assign(self.truth.len(), self.found.len(), 0.0, cost);
        found_of.iter().enumerate().filter_map(|(i, j)| j.map(|j| (i, j))).collect()
    }
}

/// Similarity of two positions at a distance (m) on the ground.
#[must_use]
pub fn ground_similarity(distance_m: f64) -> f64 {
    (1.0 - distance_m / ZERO_DISTANCE_M).max(0.0)
}

/// In how many frames each track appears.
pub(crate) fn lengths(
    sequence: &[SequenceFrame],
    ids: impl Fn(&SequenceFrame) -> &[u64],
) -> BTreeMap<u64, f64> {
    let mut lengths = BTreeMap::new();
    for id in sequence.iter().flat_map(ids) {
        *lengths.entry(*id).or_insert(0.0) += 1.0;
    }
    lengths
}

/// A frame in few words, for tests.
#[cfg(test)]
pub(crate) fn frame(truth: &[u64], found: &[u64], similarity: &[&[f64]]) -> SequenceFrame {
    SequenceFrame {
        truth: truth.to_vec(),
        found: found.to_vec(),
        similarity: similarity.iter().map(|row| row.to_vec()).collect(),
    }
}
