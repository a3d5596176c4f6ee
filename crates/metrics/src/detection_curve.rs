//! Precision against recall of a detector: average precision, and the vehicles that are found at a given precision.

use roadplane_base::{bbox_iou, bbox_share_inside};

use crate::average_precision::{FoundBox, interpolated_mean};

/// A part of a picture whose vehicles need not be found: left, top, right, bottom, px.
///
/// A detection without a true vehicle is neither right nor false if it overlaps such a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IgnoredRegion {
    /// Left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Overlap (IoU) from which the region applies, 0–1.
    pub least_iou: f64,
    /// Share of the detection inside the region from which the region applies, 0–1; above 1, it never applies this way.
    pub least_inside: f64,
}

impl IgnoredRegion {
    /// Returns a region that applies to detections that overlap it by half (IoU), or lie inside it by half.
    #[must_use]
    pub fn at_half(bbox_px: [f64; 4]) -> Self {
        Self { bbox_px, least_iou: 0.5, least_inside: 0.5 }
    }

    fn covers(&self, bbox_px: &[f64; 4]) -> bool {
        bbox_iou(bbox_px, &self.bbox_px) >= self.least_iou
            || bbox_share_inside(bbox_px, &self.bbox_px) >= self.least_inside
    }
}

/// A detection that counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// Index of the detection in its picture.
    pub detection: usize,
    /// Score of the detection.
    pub score: f64,
    /// Index of the true vehicle that it found; `None` if the detection is false.
    pub vehicle: Option<usize>,
}

/// The detections of one picture, matched to its true vehicles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JudgedPicture {
    /// Number of true vehicles.
    pub vehicles: usize,
    /// All detections that count, highest score first.
    pub judged: Vec<Judged>,
}

impl JudgedPicture {
    /// Matches detections to true boxes (left, top, right, bottom, px).
    ///
    /// Detections choose in the order of their scores. Each takes the free true box that it overlaps most, if the
    /// overlap (IoU) is at least `least_iou`.
    #[must_use]
    pub fn of(truth: &[[f64; 4]], ignored: &[IgnoredRegion], found: &[FoundBox], least_iou: f64) -> Self {
        let mut order: Vec<usize> = (0..found.len()).collect();
        order.sort_by(|&a, &b| found[b].score.total_cmp(&found[a].score));
        let mut is_free = vec![true; truth.len()];
        let mut judged = Vec::new();
        for detection in order {
            let FoundBox { bbox_px, score } = &found[detection];
            let overlaps =
                (0..truth.len()).filter(|&t| is_free[t]).map(|t| (t, bbox_iou(bbox_px, &truth[t])));
            let best = overlaps.filter(|(_, iou)| *iou >= least_iou).max_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((vehicle, _)) = best {
                is_free[vehicle] = false;
            } else if ignored.iter().any(|region| region.covers(bbox_px)) {
                continue;
            }
            judged.push(Judged { detection, score: *score, vehicle: best.map(|(vehicle, _)| vehicle) });
        }
        Self { vehicles: truth.len(), judged }
    }
}

/// Numbers of vehicles found and of false boxes from a score on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Counts {
    /// Number of vehicles found.
    pub found: usize,
    /// Number of false boxes.
    pub wrong: usize,
    /// The score.
    pub score: f64,
}

/// Vehicles found and false boxes of many pictures, for every threshold of the score.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectionCurve {
    vehicles: usize,
    /// One entry per detection, highest score first.
    counts: Vec<Counts>,
}

impl DetectionCurve {
    /// Joins the detections of pictures.
    #[must_use]
    pub fn of(pictures: &[&JudgedPicture]) -> Self {
        let mut all: Vec<(f64, bool)> =
            pictures.iter().flat_map(|p| &p.judged).map(|j| (j.score, j.vehicle.is_some())).collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (mut found, mut wrong) = (0, 0);
        let counts = all.into_iter().map(|(score, is_right)| {
            found += usize::from(is_right);
            wrong += usize::from(!is_right);
            Counts { found, wrong, score }
        });
        Self { counts: counts.collect(), vehicles: pictures.iter().map(|p| p.vehicles).sum() }
    }

    /// Returns the number of true vehicles.
    #[must_use]
    pub fn vehicles(&self) -> usize {
        self.vehicles
    }

    /// Returns the average precision, 0–1: the mean over 101 levels of recall of the best precision from that recall on.
    /// It is NaN without vehicles. Unlike COCO's figure, it has no limit on the number of boxes in a picture.
    #[must_use]
    pub fn average_precision(&self) -> f64 {
        if self.vehicles == 0 {
            return f64::NAN;
        }
        let recall = |counts: &Counts| counts.found as f64 / self.vehicles as f64;
        interpolated_mean(self.counts.iter().map(|counts| (recall(counts), precision(counts))).collect())
    }

    /// Returns the counts at the lowest score at which the precision is at least `least` (0–1); `None` if no score
    /// reaches it.
    #[must_use]
    pub fn at_precision(&self, least: f64) -> Option<Counts> {
        self.thresholds().filter(|counts| precision(counts) >= least).last()
    }

    /// Returns the counts at the score with the largest F1, the harmonic mean of precision and recall; `None` if no
    /// vehicle is found.
    #[must_use]
    pub fn at_best_f1(&self) -> Option<Counts> {
        let f1 = |c: &Counts| 2.0 * c.found as f64 / (c.found + c.wrong + self.vehicles) as f64;
        self.thresholds().filter(|counts| counts.found > 0).max_by(|a, b| f1(a).total_cmp(&f1(b)))
    }

    /// Returns the counts at each score, highest score first. Detections with equal scores come together, because no
    /// threshold separates them.
    fn thresholds(&self) -> impl Iterator<Item = Counts> {
        self.counts.chunk_by(|a, b| a.score.total_cmp(&b.score).is_eq()).filter_map(<[Counts]>::last).copied()
    }

    /// Returns the counts from this score on.
    #[must_use]
    pub fn from_score(&self, score: f64) -> Counts {
        let kept = self.counts.partition_point(|counts| counts.score >= score);
        let last =
            kept.checked_sub(1).map_or((0, 0), |last| (self.counts[last].found, self.counts[last].wrong));
        Counts { found: last.0, wrong: last.1, score }
    }
}

fn precision(counts: &Counts) -> f64 {
    counts.found as f64 / (counts.found + counts.wrong) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bbox(x: f64) -> [f64; 4] {
        [x, 0.0, x + 40.0, 40.0]
    }

    fn found(x: f64, score: f64) -> FoundBox {
        FoundBox { bbox_px: bbox(x), score }
    }

    #[test]
    fn detections_take_the_vehicle_that_they_overlap_most() {
        let truth = [bbox(0.0), bbox(10.0)];
        let picture =
            JudgedPicture::of(&truth, &[], &[found(9.0, 0.5), found(8.0, 0.9), found(4.0, 0.3)], 0.5);
        let pairs: Vec<_> = picture.judged.iter().map(|j| (j.detection, j.vehicle)).collect();
        assert_eq!(pairs, [(1, Some(1)), (0, Some(0)), (2, None)]);
    }

    #[test]
    fn detections_on_ignored_regions_do_not_count() {
        let region = IgnoredRegion { bbox_px: [0.0, 0.0, 400.0, 40.0], least_iou: 0.5, least_inside: 0.5 };
        let inside = [found(100.0, 0.9), found(390.0, 0.8)];
        assert_eq!(JudgedPicture::of(&[], &[region], &inside, 0.5).judged.len(), 1);
        let overlap_alone = IgnoredRegion { least_inside: 2.0, ..region };
        assert_eq!(JudgedPicture::of(&[], &[overlap_alone], &inside, 0.5).judged.len(), 2);
    }

    #[test]
    fn detections_with_equal_scores_are_not_separated() {
        let boxes = [found(0.0, 0.9), found(100.0, 0.8), found(500.0, 0.8)];
        let curve = DetectionCurve::of(&[&JudgedPicture::of(&[bbox(0.0), bbox(100.0)], &[], &boxes, 0.5)]);
        assert_eq!(curve.at_precision(0.9), Some(Counts { found: 1, wrong: 0, score: 0.9 }));
        assert_eq!(curve.at_best_f1(), Some(Counts { found: 2, wrong: 1, score: 0.8 }));
        let nothing = DetectionCurve::of(&[&JudgedPicture::of(&[], &[], &boxes, 0.5)]);
        assert_eq!((nothing.at_precision(0.9), nothing.at_best_f1()), (None, None));
    }

    #[test]
    fn figures_of_a_short_curve_are_exact() {
        // Right, right, false, right, false; a fourth vehicle is not found.
        let truth = [bbox(0.0), bbox(100.0), bbox(200.0), bbox(300.0)];
        let boxes =
            [found(0.0, 0.9), found(100.0, 0.8), found(500.0, 0.7), found(200.0, 0.6), found(600.0, 0.5)];
        let picture = JudgedPicture::of(&truth, &[], &boxes, 0.5);
        let curve = DetectionCurve::of(&[&picture]);
        assert_eq!(curve.at_precision(0.9), Some(Counts { found: 2, wrong: 0, score: 0.8 }));
        assert_eq!(curve.at_precision(0.75), Some(Counts { found: 3, wrong: 1, score: 0.6 }));
        assert_eq!(curve.at_best_f1(), Some(Counts { found: 3, wrong: 1, score: 0.6 }));
        assert_eq!(curve.from_score(0.65), Counts { found: 2, wrong: 1, score: 0.65 });
        assert_eq!(curve.from_score(0.95), Counts { found: 0, wrong: 0, score: 0.95 });
        // Precision 1 up to a recall of 0.5 (51 levels), and 0.75 up to 0.75 (25 levels).
        assert!((curve.average_precision() - (51.0 + 25.0 * 0.75) / 101.0).abs() < 1e-9);
        assert!(DetectionCurve::of(&[]).average_precision().is_nan());
    }
}
