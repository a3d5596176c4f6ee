//! The input of the tracking metrics: the objects of each frame, and the similarity of each pair.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::assign;

/// Distance at which the similarity on the ground falls to 0, m (Luiten et al. 2021 §5: `max(0, 1 − d /
/// zero_distance)`).
pub const ZERO_DISTANCE_M: f64 = 4.0;

/// Slack of comparisons with a threshold, as in the reference implementation.
pub(crate) const EPSILON: f64 = f64::EPSILON;

/// One frame of a sequence.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SequenceFrame {
    /// Ids of the true tracks in this frame.
    pub truth: Vec<u64>,
    /// Ids of the found tracks in this frame.
    pub found: Vec<u64>,
    /// Similarity of each pair, 0–1: `similarity[i][j]` is that of `truth[i]` and `found[j]`.
    pub similarity: Vec<Vec<f64>>,
}

/// A clip as a list of frames.
pub type Sequence = Vec<SequenceFrame>;

impl SequenceFrame {
    /// Returns the frame of objects with ids, for any measure of similarity.
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

    /// Returns the frame of positions on the ground, m.
    #[must_use]
    pub fn on_ground(truth: &[(u64, Vector2<f64>)], found: &[(u64, Vector2<f64>)]) -> Self {
        Self::new(truth, found, |a, b| ground_similarity((a - b).norm()))
    }

    /// Returns the pairs (index in truth, index in found) with the greatest sum of scores. Pairs with score 0 are left
    /// out.
    pub fn pairs(&self, score: impl Fn(usize, usize) -> f64) -> Vec<(usize, usize)> {
        // Scores are far below 1 if tracks seldom meet, and the assignment rounds to 1e-6.
        let cost = |i: usize, j: usize| -1e3 * score(i, j);
        let found_of = assign(self.truth.len(), self.found.len(), 0.0, cost);
        found_of.iter().enumerate().filter_map(|(i, j)| j.map(|j| (i, j))).collect()
    }
}

/// Returns the similarity of two positions at a distance (m) on the ground.
#[must_use]
pub fn ground_similarity(distance_m: f64) -> f64 {
    (1.0 - distance_m / ZERO_DISTANCE_M).max(0.0)
}

/// Returns the number of frames of each track.
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

/// Returns a frame in short form, for tests.
#[cfg(test)]
pub(crate) fn frame(truth: &[u64], found: &[u64], similarity: &[&[f64]]) -> SequenceFrame {
    SequenceFrame {
        truth: truth.to_vec(),
        found: found.to_vec(),
        similarity: similarity.iter().map(|row| row.to_vec()).collect(),
    }
}
