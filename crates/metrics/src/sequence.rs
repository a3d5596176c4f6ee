//! The input of the tracking metrics: the true and estimated objects of each frame, and the similarity of each pair.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::assign;

/// Distance on the ground at which the similarity of two positions becomes 0, m. At a distance d the similarity is
/// `max(0, 1 − d / ZERO_DISTANCE_M)` (Luiten et al. 2021, §5).
pub const ZERO_DISTANCE_M: f64 = 4.0;

/// Tolerance in comparisons of a similarity with a threshold, as in TrackEval.
pub(crate) const EPSILON: f64 = f64::EPSILON;

/// One frame of a sequence: its true and estimated objects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SequenceFrame {
    /// Ids of the true tracks in this frame.
    pub truth: Vec<u64>,
    /// Ids of the estimated tracks in this frame.
    pub found: Vec<u64>,
    /// Similarity of each pair, 0–1. `similarity[i][j]` compares `truth[i]` with `found[j]`.
    pub similarity: Vec<Vec<f64>>,
}

/// A clip as a list of frames.
pub type Sequence = Vec<SequenceFrame>;

impl SequenceFrame {
    /// Creates a frame from objects with ids. `similarity` returns the similarity of two objects, 0–1.
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

    /// Creates a frame from objects with ids and positions on the ground, m.
    #[must_use]
    pub fn on_ground(truth: &[(u64, Vector2<f64>)], found: &[(u64, Vector2<f64>)]) -> Self {
        Self::new(truth, found, |a, b| ground_similarity((a - b).norm()))
    }

    /// Returns the pairs of objects that give the greatest sum of scores. A pair has the index in `truth` and the index
    /// in `found`. Pairs with a score of 0 are left out.
    pub fn pairs(&self, score: impl Fn(usize, usize) -> f64) -> Vec<(usize, usize)> {
        // Scores are far below 1 for tracks with few common frames. They are scaled up because the assignment rounds
        // its costs to 1e-6.
        let cost = |i: usize, j: usize| -1e3 * score(i, j);
        let found_of = assign(self.truth.len(), self.found.len(), 0.0, cost);
        found_of.iter().enumerate().filter_map(|(i, j)| j.map(|j| (i, j))).collect()
    }
}

/// Returns the similarity (0–1) of two positions that are `distance_m` apart on the ground.
#[must_use]
pub fn ground_similarity(distance_m: f64) -> f64 {
    (1.0 - distance_m / ZERO_DISTANCE_M).max(0.0)
}

/// Returns the number of frames of each track, by the id of the track.
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

/// Creates a frame for tests.
#[cfg(test)]
pub(crate) fn frame(truth: &[u64], found: &[u64], similarity: &[&[f64]]) -> SequenceFrame {
    SequenceFrame {
        truth: truth.to_vec(),
        found: found.to_vec(),
        similarity: similarity.iter().map(|row| row.to_vec()).collect(),
    }
}
