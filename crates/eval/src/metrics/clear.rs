//! CLEAR MOT (Bernardin & Stiefelhagen 2008, "Evaluating Multiple Object Tracking Performance"), computed as in TrackEval:
//! matches of the frame before are kept while they pass the threshold, the rest by greatest similarity.

use std::collections::BTreeMap;

use super::sequence::{EPSILON, SequenceFrame};

/// A pair below this similarity is no match (on the ground: 2 m).
pub const THRESHOLD: f64 = 0.5;

/// Counts and the two scores.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clear {
    /// 1 − (misses + false ones + switches) / truths; below 0 where there are more errors than truths.
    pub mota: f64,
    /// Mean similarity of the matches.
    pub motp: f64,
    /// Matches.
    pub hits: u64,
    /// Truths without a match.
    pub misses: u64,
    /// Found ones without a match.
    pub false_alarms: u64,
    /// Times that a true track goes on under another id.
    pub switches: u64,
}

/// CLEAR MOT of one sequence.
#[must_use]
pub fn clear(sequence: &[SequenceFrame]) -> Clear {
    let mut last_of: BTreeMap<u64, u64> = BTreeMap::new();
    let mut in_frame_before: BTreeMap<u64, u64> = BTreeMap::new();
    let mut result = Clear { mota: 0.0, motp: 0.0, hits: 0, misses: 0, false_alarms: 0, switches: 0 };
    let mut similarity_sum = 0.0;
    for frame in sequence {
        // As in the reference, a frame without one side is no frame in between.
        if frame.truth.is_empty() || frame.found.is_empty() {
            result.misses += frame.truth.len() as u64;
            result.false_alarms += frame.found.len() as u64;
            continue;
        }
        let score = |i: usize, j: usize| {
            let similarity = frame.similarity[i][j];
            let kept = in_frame_before.get(&frame.truth[i]) == Some(&frame.found[j]);
            let bonus = if kept { 1000.0 } else { 0.0 };
            if similarity < THRESHOLD - EPSILON { 0.0 } else { bonus + similarity }
        };
        let pairs = frame.pairs(score);
        result.hits += pairs.len() as u64;
        result.misses += (frame.truth.len() - pairs.len()) as u64;
        result.false_alarms += (frame.found.len() - pairs.len()) as u64;
        in_frame_before.clear();
        for (i, j) in pairs {
            let (truth, found) = (frame.truth[i], frame.found[j]);
            similarity_sum += frame.similarity[i][j];
            let before = last_of.insert(truth, found);
            result.switches += u64::from(before.is_some_and(|id| id != found));
            in_frame_before.insert(truth, found);
        }
    }
    let truths = (result.hits + result.misses).max(1) as f64;
    result.mota = (result.hits as f64 - result.false_alarms as f64 - result.switches as f64) / truths;
    result.motp = similarity_sum / result.hits.max(1) as f64;
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(truth: &[u64], found: &[u64], similarity: &[&[f64]]) -> SequenceFrame {
        SequenceFrame {
            truth: truth.to_vec(),
            found: found.to_vec(),
            similarity: similarity.iter().map(|row| row.to_vec()).collect(),
        }
    }

    #[test]
    fn misses_false_alarms_and_switches_are_counted() {
        let sequence = [
            frame(&[1, 2], &[7, 8], &[&[0.9, 0.0], &[0.0, 0.8]]),
            // Track 1 goes on as 9; 8 is too far from 2: a miss and a false alarm.
            frame(&[1, 2], &[9, 8], &[&[0.7, 0.0], &[0.0, 0.4]]),
            frame(&[1], &[], &[&[]]),
            // Back to 7: another switch.
            frame(&[1], &[7], &[&[0.6]]),
        ];
        let score = clear(&sequence);
        assert_eq!((score.hits, score.misses, score.false_alarms, score.switches), (4, 2, 1, 2));
        assert!((score.mota - (4.0 - 1.0 - 2.0) / 6.0).abs() < 1e-12);
        assert!((score.motp - (0.9 + 0.8 + 0.7 + 0.6) / 4.0).abs() < 1e-12);
    }

    #[test]
    fn a_match_is_kept_although_another_is_nearer() {
        let sequence = [frame(&[1], &[7], &[&[0.9]]), frame(&[1], &[7, 8], &[&[0.55, 0.95]])];
        let score = clear(&sequence);
        assert_eq!((score.hits, score.false_alarms, score.switches), (2, 1, 0));
    }
}
