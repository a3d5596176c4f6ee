//! Average precision (AP) of boxes, as COCO defines it (Lin et al. 2014, "Microsoft COCO").
//!
//! The computation follows COCO's evaluation code, pycocotools. Detections are matched greedily in the order of their
//! scores. There are ten IoU thresholds, 101 recall points, and at most 100 detections per picture.

use roadplane_base::bbox_iou;

/// Number of IoU thresholds: 0.50, 0.55 … 0.95.
pub const IOU_THRESHOLDS: usize = 10;
/// Number of recall values at which the precision is sampled: 0.00, 0.01 … 1.00.
const RECALL_POINTS: usize = 101;
/// Largest number of detections per picture. Only those with the highest scores are evaluated.
const MAX_DETECTIONS: usize = 100;

/// A true box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueBox {
    /// Left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Area that determines the size class ([`Size`]), px². It is the area of the object's outline if the outline is
    /// given. Otherwise it is the area of the box.
    pub area_px2: f64,
    /// Whether the evaluation ignores the box, because it is too small, too hidden, or of another category. An ignored
    /// box is never a miss, and a detection of it is no false alarm.
    pub ignore: bool,
    /// Whether the box is a region with several objects. Any number of detections may lie in the region, and none of
    /// them is a false alarm.
    pub crowd: bool,
}

impl TrueBox {
    /// Creates a true box that is not a crowd region. The area of the box determines its size class.
    #[must_use]
    pub fn new(bbox_px: [f64; 4], ignore: bool) -> Self {
        Self { bbox_px, area_px2: area(&bbox_px), ignore, crowd: false }
    }
}

/// A detected box with its score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundBox {
    /// Left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Score of the detection. Only the order of the scores matters.
    pub score: f64,
}

/// The true boxes and the detections of one picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PictureBoxes {
    /// The true boxes.
    pub truth: Vec<TrueBox>,
    /// The detections.
    pub found: Vec<FoundBox>,
}

/// A size class of COCO, by the area of the box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Any size.
    All,
    /// Area up to 32² px².
    Small,
    /// Area of 32² to 96² px².
    Medium,
    /// Area of 96² px² or more.
    Large,
}

impl Size {
    /// All size classes.
    pub const EACH: [Self; 4] = [Self::All, Self::Small, Self::Medium, Self::Large];

    fn holds(self, area_px2: f64) -> bool {
        let (low, high) = match self {
            Self::All => (0.0, 1e10),
            Self::Small => (0.0, 1024.0),
            Self::Medium => (1024.0, 9216.0),
            Self::Large => (9216.0, 1e10),
        };
        (low..=high).contains(&area_px2)
    }
}

/// Average precision, 0–1 (AP of COCO).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AveragePrecision {
    /// Mean of the average precision over the ten IoU thresholds.
    pub ap: f64,
    /// Average precision at the IoU threshold 0.5.
    pub ap50: f64,
}

/// The result of matching one picture's detections with its true boxes, for one size class.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureMatch {
    /// Number of true boxes that are not ignored.
    to_find: usize,
    /// For each IoU threshold, the detections that are evaluated: the score of each, and whether it is a hit.
    outcomes: [Vec<(f64, bool)>; IOU_THRESHOLDS],
}

impl PictureMatch {
    /// Matches the detections of a picture with its true boxes. All boxes must be of one category.
    #[must_use]
    pub fn of(picture: &PictureBoxes, size: Size) -> Self {
        Self {
            to_find: picture.truth.iter().filter(|truth| !ignored(truth, size)).count(),
            outcomes: std::array::from_fn(|step| matched(picture, size, 0.5 + 0.05 * step as f64)),
        }
    }
}

/// Returns the average precision over all pictures. Returns `None` if the pictures have no true boxes, or if all true
/// boxes are ignored.
#[must_use]
pub fn average_precision(pictures: &[&PictureMatch]) -> Option<AveragePrecision> {
    let at: Option<Vec<f64>> = (0..IOU_THRESHOLDS).map(|step| at_threshold(pictures, step)).collect();
    let at = at?;
    Some(AveragePrecision { ap: at.iter().sum::<f64>() / IOU_THRESHOLDS as f64, ap50: *at.first()? })
}

fn at_threshold(pictures: &[&PictureMatch], step: usize) -> Option<f64> {
    let to_find: usize = pictures.iter().map(|picture| picture.to_find).sum();
    let mut outcomes: Vec<(f64, bool)> =
        pictures.iter().flat_map(|picture| &picture.outcomes[step]).copied().collect();
    if to_find == 0 {
        return None;
    }
    // The sort is stable: detections with equal scores keep the order of their pictures.
    outcomes.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut hits = 0usize;
    let mut curve: Vec<(f64, f64)> = Vec::with_capacity(outcomes.len());
    for (i, (_, hit)) in outcomes.iter().enumerate() {
        hits += usize::from(*hit);
        curve.push((hits as f64 / to_find as f64, hits as f64 / ((i + 1) as f64 + f64::EPSILON)));
    }
    Some(interpolated_mean(curve))
}

/// Returns the mean over 101 levels of recall of the best precision from that recall on. `curve` has pairs of recall and
/// precision, ordered by rising recall.
pub(crate) fn interpolated_mean(mut curve: Vec<(f64, f64)>) -> f64 {
    // The precision at a recall value is the best precision at that recall or any higher recall.
    let mut best = 0.0f64;
    for point in curve.iter_mut().rev() {
        best = best.max(point.1);
        point.1 = best;
    }
    let precision_at = |k: usize| {
        // These are the values of NumPy's linspace. If the recall is a round number, the last bit decides the
        // comparison.
        let recall = if k + 1 == RECALL_POINTS { 1.0 } else { k as f64 * 0.01 };
        curve.get(curve.partition_point(|point| point.0 < recall)).map_or(0.0, |point| point.1)
    };
    (0..RECALL_POINTS).map(precision_at).sum::<f64>() / RECALL_POINTS as f64
}

fn ignored(truth: &TrueBox, size: Size) -> bool {
    truth.ignore || truth.crowd || !size.holds(truth.area_px2)
}

/// Returns the detections that are evaluated: the score of each, and whether it is a hit.
fn matched(picture: &PictureBoxes, size: Size, threshold: f64) -> Vec<(f64, bool)> {
    let mut truths: Vec<&TrueBox> = picture.truth.iter().collect();
    truths.sort_by_key(|truth| ignored(truth, size));
    let mut founds: Vec<&FoundBox> = picture.found.iter().collect();
    founds.sort_by(|a, b| b.score.total_cmp(&a.score));
    founds.truncate(MAX_DETECTIONS);
    let mut taken = vec![false; truths.len()];
    let mut outcomes = Vec::with_capacity(founds.len());
    for found in founds {
        let mut best: Option<usize> = None;
        let mut best_overlap = threshold.min(1.0 - 1e-10);
        for (g, truth) in truths.iter().enumerate() {
            if taken[g] && !truth.crowd {
                continue;
            }
            // Ignored boxes come last in the list. They never replace a match with a box that is not ignored.
            if best.is_some_and(|b| !ignored(truths[b], size)) && ignored(truth, size) {
                break;
            }
            let overlap = overlap(found, truth);
            if overlap >= best_overlap {
                best_overlap = overlap;
                best = Some(g);
            }
        }
        match best {
            Some(g) => {
                taken[g] = true;
                if !ignored(truths[g], size) {
                    outcomes.push((found.score, true));
                }
            }
            None if size.holds(area(&found.bbox_px)) => outcomes.push((found.score, false)),
            None => {}
        }
    }
    outcomes
}

/// Returns the IoU of a detection and a true box. For a crowd region, returns the share of the detection's area that
/// lies in the region.
fn overlap(found: &FoundBox, truth: &TrueBox) -> f64 {
    let (a, b) = (&found.bbox_px, &truth.bbox_px);
    if !truth.crowd {
        return bbox_iou(a, b);
    }
    let common = area(&[a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])]);
    common / area(a)
}

fn area([x0, y0, x1, y1]: &[f64; 4]) -> f64 {
    (x1 - x0).max(0.0) * (y1 - y0).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ap(picture: &PictureBoxes, size: Size) -> Option<AveragePrecision> {
        average_precision(&[&PictureMatch::of(picture, size)])
    }

    fn truth(bbox_px: [f64; 4]) -> TrueBox {
        TrueBox::new(bbox_px, false)
    }

    #[test]
    fn one_of_two_is_found_with_a_false_box_between() {
        let picture = PictureBoxes {
            truth: vec![truth([0.0, 0.0, 10.0, 10.0]), truth([50.0, 0.0, 60.0, 10.0])],
            found: vec![
                FoundBox { bbox_px: [0.0, 0.0, 10.0, 10.0], score: 0.9 },
                FoundBox { bbox_px: [100.0, 0.0, 110.0, 10.0], score: 0.8 },
                // The IoU with the second true box is 0.8: a hit at seven of the ten thresholds (0.5 … 0.8).
                FoundBox { bbox_px: [50.0, 0.0, 58.0, 10.0], score: 0.7 },
            ],
        };
        let result = ap(&picture, Size::All).unwrap();
        // The precision is 1 for recall 0–0.5 (51 points), and 2/3 up to recall 1.0 (50 points).
        let both = (51.0 + 50.0 * 2.0 / 3.0) / 101.0;
        assert!((result.ap50 - both).abs() < 1e-9, "{result:?}");
        assert!((result.ap - (7.0 * both + 3.0 * 51.0 / 101.0) / 10.0).abs() < 1e-9);
        assert_eq!(ap(&picture, Size::Large), None);
        assert!((ap(&picture, Size::Small).unwrap().ap - result.ap).abs() < 1e-12);
    }

    #[test]
    fn ignored_and_crowded_boxes_cost_nothing() {
        let crowd = TrueBox { crowd: true, ..truth([100.0, 0.0, 200.0, 100.0]) };
        let hidden = TrueBox::new([300.0, 0.0, 310.0, 10.0], true);
        let found = |x: f64, score: f64| FoundBox { bbox_px: [x, 0.0, x + 10.0, 10.0], score };
        let picture = PictureBoxes {
            truth: vec![truth([0.0, 0.0, 10.0, 10.0]), crowd, hidden],
            found: vec![found(120.0, 0.99), found(140.0, 0.98), found(300.0, 0.97), found(0.0, 0.5)],
        };
        assert!((ap(&picture, Size::All).unwrap().ap - 1.0).abs() < 1e-9);
    }
}
