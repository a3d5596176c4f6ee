//! One list of vehicles out of many overlapping boxes.

use roadplane_base::{VehicleClass, bbox_covered, bbox_iou};

use crate::DetectOptions;
use crate::decode::{CLASSES, Candidate};

/// Sizes that the net finds reliably, px of its input (square root of the area): a pass whose scaling brings a vehicle
/// into this range must have seen it. Found on the frames of `tests/virat.rs`.
const NET_SIZES_PX: std::ops::RangeInclusive<f64> = 28.0..=200.0;

/// A vehicle found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Found {
    pub bbox: [f64; 4],
    pub score: f64,
    pub class: VehicleClass,
}

/// Merges what all passes found: within each pass by voting, then across passes, where the score is the mean over the
/// passes that should have seen the vehicle. `scales` is what each pass scaled the frame by.
pub(crate) fn merge(candidates: Vec<Candidate>, scales: &[f64], options: &DetectOptions) -> Vec<Found> {
    let mut heads: Vec<Candidate> = Vec::new();
    for pass in 0..scales.len() {
        let of_pass = candidates.iter().filter(|c| c.pass == pass).copied().collect();
        heads.extend(groups(of_pass, options).iter().map(|group| {
            let Candidate { score, class, pass, .. } = group[0];
            Candidate { bbox: mean_box(group), score, class, pass }
        }));
    }
    let mut found: Vec<Found> = groups(heads, options)
        .iter()
        .map(|group| {
            let bbox = mean_box(group);
            let score = joint_score(group, &bbox, scales);
            Found { bbox, score, class: joint_class(group) }
        })
        .filter(|f| f.score >= options.min_score && f.bbox[2] - f.bbox[0] >= options.min_width_px)
        .collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found
}

/// Groups of boxes around the best ones, best first; boxes that are suppressed by a group's head but too different to
/// improve it are dropped.
fn groups(mut boxes: Vec<Candidate>, options: &DetectOptions) -> Vec<Vec<Candidate>> {
    // Ties are broken by place, so that the result does not depend on the order.
    boxes.sort_by(|a, b| {
        b.score.total_cmp(&a.score).then_with(|| a.bbox[0].total_cmp(&b.bbox[0])).then(a.pass.cmp(&b.pass))
    });
    let mut groups: Vec<Vec<Candidate>> = Vec::new();
    for candidate in boxes {
        let overlaps = |head: &Candidate| bbox_iou(&head.bbox, &candidate.bbox) >= options.nms_iou;
        let inside = |head: &Candidate| bbox_covered(&head.bbox, &candidate.bbox) >= options.nms_covered;
        if let Some(group) = groups.iter_mut().find(|group| overlaps(&group[0])) {
            group.push(candidate);
        } else if !groups.iter().any(|group| inside(&group[0])) {
            groups.push(vec![candidate]);
        }
    }
    groups
}

/// Mean of the boxes, weighted by score.
fn mean_box(group: &[Candidate]) -> [f64; 4] {
    let total: f64 = group.iter().map(|c| c.score).sum();
    std::array::from_fn(|side| group.iter().map(|c| c.score * c.bbox[side]).sum::<f64>() / total)
}

/// Mean of each pass's best score, over the passes that should have seen a vehicle of this size; for one too small for
/// all of them the best score, for one too large the mean over all.
fn joint_score(group: &[Candidate], [x0, y0, x1, y1]: &[f64; 4], scales: &[f64]) -> f64 {
    let best_of =
        |pass: usize| group.iter().filter(|c| c.pass == pass).map(|c| c.score).fold(0.0_f64, f64::max);
    let size_px = ((x1 - x0) * (y1 - y0)).max(0.0).sqrt();
    let mut passes: Vec<usize> =
        (0..scales.len()).filter(|&pass| NET_SIZES_PX.contains(&(size_px * scales[pass]))).collect();
    if passes.is_empty() {
        let finest = scales.iter().copied().fold(0.0, f64::max);
        if size_px * finest < *NET_SIZES_PX.start() {
            return group.iter().map(|c| c.score).fold(0.0, f64::max);
        }
        passes = (0..scales.len()).collect();
    }
    passes.iter().map(|&pass| best_of(pass)).sum::<f64>() / passes.len() as f64
}

/// The class with the largest sum of scores.
fn joint_class(group: &[Candidate]) -> VehicleClass {
    let votes = |class: VehicleClass| group.iter().filter(|c| c.class == class).map(|c| c.score).sum::<f64>();
    let mut best = VehicleClass::Car;
    for class in CLASSES {
        if votes(class) > votes(best) {
            best = class;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(bbox: [f64; 4], score: f64, pass: usize) -> Candidate {
        Candidate { bbox, score, class: VehicleClass::Car, pass }
    }

    #[test]
    fn neighbours_stay_apart_and_copies_become_one() {
        let options = DetectOptions::default();
        let found = merge(
            vec![
                candidate([0.0, 0.0, 100.0, 50.0], 0.8, 0),
                candidate([4.0, 0.0, 104.0, 50.0], 0.4, 0),
                candidate([70.0, 0.0, 170.0, 50.0], 0.7, 0),
                candidate([20.0, 10.0, 60.0, 40.0], 0.6, 0), // a part of the first
                candidate([300.0, 0.0, 310.0, 8.0], 0.9, 0), // too narrow
                candidate([400.0, 0.0, 480.0, 50.0], 0.2, 0), // too weak
            ],
            &[1.0],
            &options,
        );
        assert_eq!(found.len(), 2);
        assert!((found[0].bbox[0] - 4.0 / 3.0).abs() < 1e-9 && (found[0].score - 0.8).abs() < 1e-9);
        assert!((found[1].bbox[0] - 70.0).abs() < 1e-9);
    }

    #[test]
    fn passes_that_should_have_seen_it_have_a_say() {
        let options = DetectOptions { min_score: 0.05, ..DetectOptions::default() };
        let scales = [0.5, 1.0];
        let large = [0.0, 0.0, 100.0, 100.0]; // 50 and 100 px for the net: both should see it
        let small = [200.0, 0.0, 240.0, 40.0]; // 20 and 40 px: the coarse pass cannot
        let huge = [300.0, 0.0, 1300.0, 1000.0]; // beyond both
        let tiny = [200.0, 90.0, 226.0, 110.0]; // below both
        let found = merge(
            vec![
                candidate(large, 0.8, 1),
                candidate(small, 0.6, 1),
                candidate(huge, 0.5, 0),
                candidate(tiny, 0.3, 1),
            ],
            &scales,
            &options,
        );
        let scores: Vec<f64> = found.iter().map(|f| (f.score * 100.0).round()).collect();
        assert_eq!(scores, [60.0, 40.0, 30.0, 25.0]);
    }

    #[test]
    fn the_class_is_voted_for() {
        let options = DetectOptions::default();
        let bbox = [0.0, 0.0, 100.0, 50.0];
        let truck = Candidate { class: VehicleClass::Truck, ..candidate(bbox, 0.6, 0) };
        let found = merge(
            vec![candidate(bbox, 0.7, 1), truck, Candidate { pass: 1, ..truck }],
            &[0.5, 1.0],
            &options,
        );
        assert_eq!((found.len(), found[0].class), (1, VehicleClass::Car), "one vote a pass");
    }

    proptest::proptest! {
        #[test]
        fn any_order_gives_the_same(seed in 0_u64..500) {
            let mut state = seed.wrapping_mul(6_364_136_223_846_793_005) + 1;
            let mut next = |range: f64| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 33) as f64 / (1_u64 << 31) as f64 * range
            };
            let boxes: Vec<Candidate> = (0..40).map(|i| {
                let (x, y) = (next(300.0), next(100.0));
                candidate([x, y, x + 30.0 + next(60.0), y + 20.0 + next(40.0)], 0.1 + next(0.9), i % 2)
            }).collect();
            let options = DetectOptions { min_score: 0.05, ..DetectOptions::default() };
            let forward = merge(boxes.clone(), &[0.5, 1.0], &options);
            let backward = merge(boxes.into_iter().rev().collect(), &[0.5, 1.0], &options);
            proptest::prop_assert_eq!(&forward, &backward);
            for (i, a) in forward.iter().enumerate() {
                proptest::prop_assert!(a.bbox[2] > a.bbox[0] && (0.0..=1.0).contains(&a.score));
                proptest::prop_assert!(forward[i + 1..].iter().all(|b| a.score >= b.score));
            }
        }
    }
}
