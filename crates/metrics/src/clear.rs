//! The tracking metrics CLEAR MOT (Bernardin & Stiefelhagen 2008, "Evaluating Multiple Object Tracking Performance"),
//! computed as in the program TrackEval.
//!
//! A match of the previous frame continues while its similarity passes the threshold. The remaining objects are matched
//! to give the greatest sum of similarities.

use std::collections::BTreeMap;

use super::sequence::{EPSILON, SequenceFrame};

/// Least similarity of two objects that are matched. On the ground it is the similarity at a distance of 2 m.
pub const THRESHOLD: f64 = 0.5;

/// Counts from which the CLEAR MOT metrics are computed. The counts of several clips may be added.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Clear {
    /// Number of matches between true and estimated objects, summed over all frames.
    pub hits: u64,
    /// Number of true objects without a match, summed over all frames.
    pub misses: u64,
    /// Number of estimated objects without a match, summed over all frames.
    pub false_alarms: u64,
    /// Number of identity switches. A switch is a match of a true track with another estimated track than before.
    pub switches: u64,
    /// Sum of the similarities of all matches.
    pub similarity: f64,
}

impl Clear {
    /// Returns the counts of one clip.
    #[must_use]
    pub fn of(clip: &[SequenceFrame]) -> Self {
        let mut last_of: BTreeMap<u64, u64> = BTreeMap::new();
        let mut in_frame_before: BTreeMap<u64, u64> = BTreeMap::new();
        let mut counts = Self::default();
        for frame in clip {
            // As in TrackEval, the previous frame is the last frame with both true and estimated objects.
            if frame.truth.is_empty() || frame.found.is_empty() {
                counts.misses += frame.truth.len() as u64;
                counts.false_alarms += frame.found.len() as u64;
                continue;
            }
            let score = |i: usize, j: usize| {
                let similarity = frame.similarity[i][j];
                let kept = in_frame_before.get(&frame.truth[i]) == Some(&frame.found[j]);
                let bonus = if kept { 1000.0 } else { 0.0 };
                if similarity < THRESHOLD - EPSILON { 0.0 } else { bonus + similarity }
            };
            let pairs = frame.pairs(score);
            counts.hits += pairs.len() as u64;
            counts.misses += (frame.truth.len() - pairs.len()) as u64;
            counts.false_alarms += (frame.found.len() - pairs.len()) as u64;
            in_frame_before.clear();
            for (i, j) in pairs {
                let (truth, found) = (frame.truth[i], frame.found[j]);
                counts.similarity += frame.similarity[i][j];
                let before = last_of.insert(truth, found);
                counts.switches += u64::from(before.is_some_and(|id| id != found));
                in_frame_before.insert(truth, found);
            }
        }
        counts
    }

    /// Returns the sum of the counts of several clips.
    #[must_use]
    pub fn sum<'a>(clips: impl IntoIterator<Item = &'a Self>) -> Self {
        clips.into_iter().fold(Self::default(), |sum, clip| Self {
            hits: sum.hits + clip.hits,
            misses: sum.misses + clip.misses,
            false_alarms: sum.false_alarms + clip.false_alarms,
            switches: sum.switches + clip.switches,
            similarity: sum.similarity + clip.similarity,
        })
    }

    /// Returns MOTA: 1 − (misses + false alarms + switches) / true objects. MOTA is negative if there are more errors
    /// than true objects.
    #[must_use]
    pub fn mota(&self) -> f64 {
        let truths = (self.hits + self.misses).max(1) as f64;
        (self.hits as f64 - self.false_alarms as f64 - self.switches as f64) / truths
    }

    /// Returns MOTP: the mean similarity of the matches.
    #[must_use]
    pub fn motp(&self) -> f64 {
        self.similarity / self.hits.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sequence::frame;

    #[test]
    fn misses_false_alarms_and_switches_are_counted() {
        let sequence = [
            frame(&[1, 2], &[7, 8], &[&[0.9, 0.0], &[0.0, 0.8]]),
            // Estimated track 9 replaces track 7: a switch. Track 8 is too far from true track 2: a miss and a false
            // alarm.
            frame(&[1, 2], &[9, 8], &[&[0.7, 0.0], &[0.0, 0.4]]),
            frame(&[1], &[], &[&[]]),
            // True track 1 is matched with track 7 again: another switch.
            frame(&[1], &[7], &[&[0.6]]),
        ];
        let score = Clear::of(&sequence);
        assert_eq!((score.hits, score.misses, score.false_alarms, score.switches), (4, 2, 1, 2));
        assert!((score.mota() - (4.0 - 1.0 - 2.0) / 6.0).abs() < 1e-12);
        assert!((score.motp() - (0.9 + 0.8 + 0.7 + 0.6) / 4.0).abs() < 1e-12);
    }

    #[test]
    fn a_match_is_kept_although_another_is_nearer() {
        let sequence = [frame(&[1], &[7], &[&[0.9]]), frame(&[1], &[7, 8], &[&[0.55, 0.95]])];
        let score = Clear::of(&sequence);
        assert_eq!((score.hits, score.false_alarms, score.switches), (2, 1, 0));
    }
}
