//! Merges many overlapping boxes into one list of vehicles.

use roadplane_base::{VehicleClass, bbox_iou};

use crate::DetectOptions;
use crate::decode::{CLASSES, Candidate};

/// A vehicle after merging. Its box is in px from the picture's top-left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Found {
    pub bbox: [f64; 4],
    pub score: f64,
    pub class: VehicleClass,
}

/// Merges the boxes of all passes: boxes that overlap enough show one vehicle.
///
/// A vehicle gets the highest score of its boxes, their mean weighted by score, and the class by a vote. The net was
/// trained on vehicles of all sizes, so no pass is preferred. Vehicles with a score below `min_score` are left out.
pub(crate) fn merge(candidates: Vec<Candidate>, options: &DetectOptions, min_score: f64) -> Vec<Found> {
    groups(candidates, options)
        .iter()
        .map(|group| Found { bbox: mean_box(group), score: group[0].score, class: joint_class(group) })
        .filter(|f| f.score >= min_score && f.bbox[2] - f.bbox[0] >= options.min_width_px)
        .collect()
}

/// Groups boxes that show the same vehicle, best group first. The box with the highest score is the head of its group.
/// A box that shows the head's vehicle but differs too much from the head is dropped.
fn groups(mut boxes: Vec<Candidate>, options: &DetectOptions) -> Vec<Vec<Candidate>> {
    // Ties are broken by position, so that the result does not depend on the order of the boxes.
    boxes.sort_by(|a, b| {
        let sides = || a.bbox.iter().zip(&b.bbox).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne());
        b.score.total_cmp(&a.score).then_with(|| sides().unwrap_or(std::cmp::Ordering::Equal))
    });
    let mut groups: Vec<Vec<Candidate>> = Vec::new();
    for candidate in boxes {
        let overlaps = |head: &Candidate| bbox_iou(&head.bbox, &candidate.bbox) >= options.nms_iou;
        if let Some(group) = groups.iter_mut().find(|group| overlaps(&group[0])) {
            group.push(candidate);
        } else if !groups.iter().any(|group| options.are_one(&group[0].bbox, &candidate.bbox)) {
            groups.push(vec![candidate]);
        }
    }
    groups
}

/// Returns the mean of the boxes, weighted by score.
fn mean_box(group: &[Candidate]) -> [f64; 4] {
    let total: f64 = group.iter().map(|c| c.score).sum();
    std::array::from_fn(|side| group.iter().map(|c| c.score * c.bbox[side]).sum::<f64>() / total)
}

/// Returns the class with the largest sum of scores.
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

    fn candidate(bbox: [f64; 4], score: f64) -> Candidate {
        Candidate { bbox, score, class: VehicleClass::Car }
    }

    #[test]
    fn neighbours_stay_apart_and_copies_become_one() {
        let options = DetectOptions { min_score: 0.35, nms_covered: 0.8, ..DetectOptions::default() };
        let found = merge(
            vec![
                candidate([0.0, 0.0, 100.0, 50.0], 0.8),
                candidate([4.0, 0.0, 104.0, 50.0], 0.4),
                candidate([70.0, 0.0, 170.0, 50.0], 0.7),
                candidate([20.0, 10.0, 60.0, 40.0], 0.6), // a part of the first
                candidate([300.0, 0.0, 310.0, 8.0], 0.9), // too narrow
                candidate([400.0, 0.0, 480.0, 50.0], 0.2), // too weak
            ],
            &options,
            options.min_score,
        );
        assert_eq!(found.len(), 2);
        assert!((found[0].bbox[0] - 4.0 / 3.0).abs() < 1e-9 && (found[0].score - 0.8).abs() < 1e-9);
        assert!((found[1].bbox[0] - 70.0).abs() < 1e-9);
    }

    #[test]
    fn the_class_is_a_vote() {
        let options = DetectOptions::default();
        let bbox = [0.0, 0.0, 100.0, 50.0];
        let truck = Candidate { class: VehicleClass::Truck, ..candidate(bbox, 0.5) };
        let found = merge(vec![candidate(bbox, 0.7), truck, truck], &options, options.min_score);
        assert_eq!((found.len(), found[0].class), (1, VehicleClass::Truck));
    }

    proptest::proptest! {
        #[test]
        fn any_order_gives_the_same_result(seed in 0_u64..500) {
            let mut state = seed.wrapping_mul(6_364_136_223_846_793_005) + 1;
            let mut next = |range: f64| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 33) as f64 / (1_u64 << 31) as f64 * range
            };
            let boxes: Vec<Candidate> = (0..40).map(|_| {
                let (x, y) = (next(300.0), next(100.0));
                candidate([x, y, x + 30.0 + next(60.0), y + 20.0 + next(40.0)], 0.1 + next(0.9))
            }).collect();
            let options = DetectOptions { min_score: 0.05, ..DetectOptions::default() };
            let forward = merge(boxes.clone(), &options, 0.05);
            let backward = merge(boxes.into_iter().rev().collect(), &options, 0.05);
            proptest::prop_assert_eq!(&forward, &backward);
            for (i, a) in forward.iter().enumerate() {
                proptest::prop_assert!(a.bbox[2] > a.bbox[0] && (0.0..=1.0).contains(&a.score));
                proptest::prop_assert!(forward[i + 1..].iter().all(|b| a.score >= b.score));
            }
        }
    }
}
