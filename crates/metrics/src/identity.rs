//! The identity metrics IDF1, IDP and IDR (Ristani et al. 2016, "Performance Measures and a Data Set for Multi-Target,
//! Multi-Camera Tracking").
//!
//! True and estimated tracks are assigned to each other once for the whole sequence.

use std::collections::BTreeMap;

use roadplane_base::assign;

use super::sequence::{EPSILON, SequenceFrame, lengths};

/// Least similarity of two objects that are matched.
pub const THRESHOLD: f64 = 0.5;

/// Counts from which the identity metrics are computed. The counts of several clips may be added.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Identity {
    /// Number of objects with the right identity (IDTP), summed over all frames.
    pub hits: f64,
    /// Number of true objects, summed over all frames.
    pub truths: f64,
    /// Number of estimated objects, summed over all frames.
    pub founds: f64,
}

impl Identity {
    /// Returns the counts of one clip.
    #[must_use]
    pub fn of(clip: &[SequenceFrame]) -> Self {
        let truth_frames = lengths(clip, |frame| &frame.truth);
        let found_frames = lengths(clip, |frame| &frame.found);
        let mut together: BTreeMap<(u64, u64), f64> = BTreeMap::new();
        for frame in clip {
            for (truth, row) in frame.truth.iter().zip(&frame.similarity) {
                for (found, similarity) in frame.found.iter().zip(row) {
                    if *similarity >= THRESHOLD - EPSILON {
                        *together.entry((*truth, *found)).or_insert(0.0) += 1.0;
                    }
                }
            }
        }
        // The best assignment has the most common frames, because each common frame avoids one miss and one false
        // alarm.
        let truths: Vec<u64> = truth_frames.keys().copied().collect();
        let founds: Vec<u64> = found_frames.keys().copied().collect();
        let count = |i: usize, j: usize| together.get(&(truths[i], founds[j])).copied().unwrap_or(0.0);
        let pairs = assign(truths.len(), founds.len(), 0.0, |i, j| -count(i, j));
        Self {
            hits: pairs.iter().enumerate().filter_map(|(i, j)| j.map(|j| count(i, j))).sum(),
            truths: truth_frames.values().sum(),
            founds: found_frames.values().sum(),
        }
    }

    /// Returns the sum of the counts of several clips.
    #[must_use]
    pub fn sum<'a>(clips: impl IntoIterator<Item = &'a Self>) -> Self {
        clips.into_iter().fold(Self::default(), |sum, clip| Self {
            hits: sum.hits + clip.hits,
            truths: sum.truths + clip.truths,
            founds: sum.founds + clip.founds,
        })
    }

    /// Returns IDF1 = 2 IDTP / (true objects + estimated objects), 0–1 (Eq. 10).
    #[must_use]
    pub fn idf1(&self) -> f64 {
        self.hits / (0.5 * (self.truths + self.founds)).max(1.0)
    }

    /// Returns the precision IDP = IDTP / estimated objects, 0–1 (Eq. 8).
    #[must_use]
    pub fn precision(&self) -> f64 {
        self.hits / self.founds.max(1.0)
    }

    /// Returns the recall IDR = IDTP / true objects, 0–1 (Eq. 9).
    #[must_use]
    pub fn recall(&self) -> f64 {
        self.hits / self.truths.max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longer_part_of_a_cut_track_counts() {
        let frame = |id: u64| SequenceFrame { truth: vec![1], found: vec![id], similarity: vec![vec![0.8]] };
        let mut sequence: Vec<_> = [7, 7, 7, 8].iter().map(|id| frame(*id)).collect();
        sequence.push(SequenceFrame { truth: vec![1], found: vec![], similarity: vec![vec![]] });
        let score = Identity::of(&sequence);
        assert!((score.recall() - 3.0 / 5.0).abs() < 1e-12 && (score.precision() - 3.0 / 4.0).abs() < 1e-12);
        assert!((score.idf1() - 6.0 / 9.0).abs() < 1e-12);
        let far = [SequenceFrame { truth: vec![1], found: vec![2], similarity: vec![vec![0.49]] }];
        assert!(Identity::of(&far).idf1().abs() < 1e-12);
    }
}
