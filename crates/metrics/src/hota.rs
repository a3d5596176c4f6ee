//! The tracking metric HOTA (Luiten et al. 2021, "HOTA: A Higher Order Metric for Evaluating Multi-Object Tracking"),
//! computed as in the program TrackEval.
//!
//! Every frame has one assignment between true and estimated objects. The score of a pair is its similarity times the
//! global alignment of its tracks. The assignment has the greatest sum of scores, and all 19 localisation thresholds
//! use it.

use std::collections::BTreeMap;

use super::sequence::{EPSILON, SequenceFrame, lengths};

/// Number of localisation thresholds. The thresholds are similarities: 0.05, 0.10 … 0.95.
pub const THRESHOLDS: usize = 19;

/// HOTA and its parts. Each value is 0–1 and is the mean over all thresholds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hota {
    /// HOTA: the geometric mean √(DetA · AssA) of detection and association accuracy (Eq. 15, 17).
    pub hota: f64,
    /// Detection accuracy DetA = TP / (TP + FN + FP), from the numbers of matches (TP), misses (FN) and false alarms
    /// (FP) (Eq. 18).
    pub det_a: f64,
    /// Association accuracy AssA: the mean over all matches of TPA / (TPA + FNA + FPA) (Eq. 16).
    ///
    /// TPA is the number of frames in which the two tracks of a match are matched with each other. FNA and FPA count
    /// the remaining frames of the true track and of the estimated track.
    pub ass_a: f64,
    /// Localisation accuracy LocA: the mean similarity of the matches (Eq. 21).
    pub loc_a: f64,
}

/// Counts from which HOTA is computed. The counts of several clips may be added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HotaCounts {
    /// Number of true objects, summed over all frames.
    pub truths: f64,
    /// Number of estimated objects, summed over all frames.
    pub founds: f64,
    /// Three values for each threshold: the number of matches, the sum of their association accuracies, and the sum of
    /// their similarities.
    pub at: [[f64; 3]; THRESHOLDS],
}

impl HotaCounts {
    /// Returns the counts of one clip.
    #[must_use]
    pub fn of(clip: &[SequenceFrame]) -> Self {
        let truth_frames = lengths(clip, |frame| &frame.truth);
        let found_frames = lengths(clip, |frame| &frame.found);
        let alignment = global_alignment(clip, &truth_frames, &found_frames);
        // Matched pairs of tracks with their similarity. All thresholds use the same pairs.
        let mut matches: Vec<((u64, u64), f64)> = Vec::new();
        for frame in clip {
            let score = |i: usize, j: usize| {
                let of_pair = alignment.get(&(frame.truth[i], frame.found[j]));
                of_pair.copied().unwrap_or(0.0) * frame.similarity[i][j]
            };
            let pairs = frame.pairs(score).into_iter();
            matches.extend(pairs.map(|(i, j)| ((frame.truth[i], frame.found[j]), frame.similarity[i][j])));
        }
        let at = std::array::from_fn(|step| {
            let threshold = 0.05 * (step + 1) as f64;
            let mut of_pair: BTreeMap<(u64, u64), f64> = BTreeMap::new();
            let (mut hits, mut similarity_sum) = (0.0, 0.0);
            for (pair, similarity) in &matches {
                if *similarity >= threshold - EPSILON {
                    *of_pair.entry(*pair).or_insert(0.0) += 1.0;
                    hits += 1.0;
                    similarity_sum += similarity;
                }
            }
            let association = |(pair, count): (&(u64, u64), &f64)| {
                count * count / (truth_frames[&pair.0] + found_frames[&pair.1] - count).max(1.0)
            };
            [hits, of_pair.iter().map(association).sum(), similarity_sum]
        });
        Self { truths: truth_frames.values().sum(), founds: found_frames.values().sum(), at }
    }

    /// Returns the sum of the counts of several clips, as TrackEval combines sequences.
    #[must_use]
    pub fn sum<'a>(clips: impl IntoIterator<Item = &'a Self>) -> Self {
        clips.into_iter().fold(Self::default(), |mut sum, clip| {
            sum.truths += clip.truths;
            sum.founds += clip.founds;
            for (sum, part) in sum.at.iter_mut().flatten().zip(clip.at.iter().flatten()) {
                *sum += part;
            }
            sum
        })
    }

    /// Computes HOTA and its parts from the counts.
    #[must_use]
    pub fn score(&self) -> Hota {
        let mut sums = Hota { hota: 0.0, det_a: 0.0, ass_a: 0.0, loc_a: 0.0 };
        for [hits, association, similarity] in self.at {
            let det_a = hits / (self.truths + self.founds - hits).max(1.0);
            let ass_a = association / hits.max(1.0);
            sums.det_a += det_a;
            sums.ass_a += ass_a;
            sums.hota += (det_a * ass_a).sqrt();
            // As in TrackEval, the localisation accuracy is 1 if there are no matches.
            sums.loc_a += if hits > 0.0 { similarity / hits } else { 1.0 };
        }
        let mean = |sum: f64| sum / THRESHOLDS as f64;
        Hota {
            hota: mean(sums.hota),
            det_a: mean(sums.det_a),
            ass_a: mean(sums.ass_a),
            loc_a: mean(sums.loc_a),
        }
    }
}

/// Returns the global alignment of each pair of a true and an estimated track: the Jaccard index of their soft matches
/// over the whole sequence.
///
/// The alignment decides between assignments that are equally good in a single frame.
fn global_alignment(
    sequence: &[SequenceFrame],
    truth_frames: &BTreeMap<u64, f64>,
    found_frames: &BTreeMap<u64, f64>,
) -> BTreeMap<(u64, u64), f64> {
    let mut potential: BTreeMap<(u64, u64), f64> = BTreeMap::new();
    for frame in sequence {
        let of_truth: Vec<f64> = frame.similarity.iter().map(|row| row.iter().sum()).collect();
        let of_found: Vec<f64> =
            (0..frame.found.len()).map(|j| frame.similarity.iter().map(|row| row[j]).sum()).collect();
        for (i, truth) in frame.truth.iter().enumerate() {
            for (j, found) in frame.found.iter().enumerate() {
                let similarity = frame.similarity[i][j];
                let union = of_truth[i] + of_found[j] - similarity;
                if union > EPSILON {
                    *potential.entry((*truth, *found)).or_insert(0.0) += similarity / union;
                }
            }
        }
    }
    let jaccard = |(pair, count): ((u64, u64), f64)| {
        (pair, count / (truth_frames[&pair.0] + found_frames[&pair.1] - count))
    };
    potential.into_iter().map(jaccard).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sequence::frame;

    fn score(clip: &[SequenceFrame]) -> Hota {
        HotaCounts::of(clip).score()
    }

    #[test]
    fn a_perfect_track_scores_one() {
        let score = score(&[frame(&[1], &[7], &[&[1.0]]), frame(&[1], &[7], &[&[1.0]])]);
        for value in [score.hota, score.det_a, score.ass_a, score.loc_a] {
            assert!((value - 1.0).abs() < 1e-12, "{score:?}");
        }
    }

    #[test]
    fn a_track_cut_in_two_loses_association_only() {
        // The ids in the four frames are 7, 7, 8, 8, so DetA is 1. Each match has TPA 2, FNA 2 and FPA 0, so AssA is
        // 1/2.
        let sequence: Vec<_> = [7, 7, 8, 8].iter().map(|id| frame(&[1], &[*id], &[&[1.0]])).collect();
        let score = score(&sequence);
        assert!((score.det_a - 1.0).abs() < 1e-12 && (score.ass_a - 0.5).abs() < 1e-12, "{score:?}");
        assert!((score.hota - 0.5f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn poor_positions_count_at_low_thresholds_only() {
        // A similarity of 0.5 passes ten of the 19 thresholds. One of the two frames has a false track.
        let sequence = [frame(&[1], &[7], &[&[0.5]]), frame(&[1], &[7, 9], &[&[0.5, 0.0]])];
        let score = score(&sequence);
        assert!((score.det_a - 10.0 / 19.0 * (2.0 / 3.0)).abs() < 1e-12, "{score:?}");
        assert!((score.ass_a - 10.0 / 19.0).abs() < 1e-12);
        assert!((score.loc_a - (10.0 * 0.5 + 9.0) / 19.0).abs() < 1e-12);
    }

    #[test]
    fn clips_add_up_as_one_long_clip_with_ids_of_its_own() {
        let clip: Vec<_> = [7, 7, 8].iter().map(|id| frame(&[1], &[*id], &[&[0.7]])).collect();
        let other = vec![frame(&[1, 2], &[7], &[&[0.2], &[0.6]])];
        let renamed = vec![frame(&[11, 12], &[17], &[&[0.2], &[0.6]])];
        let sum = HotaCounts::sum([&HotaCounts::of(&clip), &HotaCounts::of(&other)]).score();
        let joined = score(&[clip, renamed].concat());
        assert!((sum.hota - joined.hota).abs() < 1e-12 && (sum.ass_a - joined.ass_a).abs() < 1e-12);
    }

    #[test]
    fn empty_results_and_empty_truth_score_zero() {
        assert!(score(&[frame(&[1], &[], &[&[]])]).hota.abs() < 1e-12);
        assert!(score(&[]).hota.abs() < 1e-12);
    }
}
