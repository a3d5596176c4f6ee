//! Identity measures (Ristani et al. 2016, "Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking"):
//! one assignment of tracks for the whole sequence.

use std::collections::BTreeMap;

use roadplane_base::assign;

use super::sequence::{EPSILON, SequenceFrame, lengths};

/// A pair below this similarity is no match.
pub const THRESHOLD: f64 = 0.5;

/// Share of frames with the right identity, 0–1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identity {
    /// 2 IDTP / (truths + founds) (Eq. 10).
    pub idf1: f64,
    /// IDTP / founds (Eq. 8).
    pub precision: f64,
    /// IDTP / truths (Eq. 9).
    pub recall: f64,
}

/// IDF1 of one sequence.
#[must_use]
pub fn identity(sequence: &[SequenceFrame]) -> Identity {
    let truth_frames = lengths(sequence, |frame| &frame.truth);
    let found_frames = lengths(sequence, |frame| &frame.found);
    let mut together: BTreeMap<(u64, u64), f64> = BTreeMap::new();
    for frame in sequence {
        for (truth, row) in frame.truth.iter().zip(&frame.similarity) {
            for (found, similarity) in frame.found.iter().zip(row) {
                if *similarity >= THRESHOLD - EPSILON {
                    *together.entry((*truth, *found)).or_insert(0.0) += 1.0;
                }
            }
        }
    }
    // Least wrong identities = most frames together: a pair of tracks saves one miss and one false alarm each.
    let truths: Vec<u64> = truth_frames.keys().copied().collect();
    let founds: Vec<u64> = found_frames.keys().copied().collect();
    let count = |i: usize, j: usize| together.get(&(truths[i], founds[j])).copied().unwrap_or(0.0);
    let pairs = assign(truths.len(), founds.len(), 0.0, |i, j| -count(i, j));
    let hits: f64 = pairs.iter().enumerate().filter_map(|(i, j)| j.map(|j| count(i, j))).sum();
    let (of_truth, of_found): (f64, f64) = (truth_frames.values().sum(), found_frames.values().sum());
    Identity {
        idf1: hits / (0.5 * (of_truth + of_found)).max(1.0),
        precision: hits / of_found.max(1.0),
        recall: hits / of_truth.max(1.0),
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
        let score = identity(&sequence);
        assert!((score.recall - 3.0 / 5.0).abs() < 1e-12 && (score.precision - 3.0 / 4.0).abs() < 1e-12);
        assert!((score.idf1 - 6.0 / 9.0).abs() < 1e-12);
        let far = [SequenceFrame { truth: vec![1], found: vec![2], similarity: vec![vec![0.49]] }];
        assert!(identity(&far).idf1.abs() < 1e-12);
    }
}
