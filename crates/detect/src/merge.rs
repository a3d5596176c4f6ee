//! Merges many overlapping boxes into one list of vehicles.

use roadplane_base::{VehicleClass, bbox_iou};

use crate::DetectOptions;
use crate::decode::{CLASSES, Candidate};

/// Largest size of a vehicle that a pass scores, px of the net's input. Larger vehicles are scored by a coarser pass,
/// if there is one. The size is the square root of the box's area. This limit and [`SMALLEST_PX`] come from two
/// sources: the frames of `tests/virat.rs`, and a car park with cars of 100 to 340 px.
const LARGEST_PX: f64 = 160.0;
/// Smallest size of a vehicle that a pass must detect, px of the net's input. Smaller vehicles are left to a finer
/// pass, if there is one. The size is the square root of the box's area.
const SMALLEST_PX: f64 = 28.0;

/// A vehicle after merging. Its box is in px from the picture's top-left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Found {
    pub bbox: [f64; 4],
    pub score: f64,
    pub class: VehicleClass,
}

/// Merges the boxes within each pass, and then across passes.
///
/// A vehicle's score is its mean score over the passes that are suited to its size. `scales` are the factors by which
/// the passes scaled the frame, coarsest first. Vehicles with a score below `min_score` are left out.
pub(crate) fn merge(
    candidates: Vec<Candidate>,
    scales: &[f64],
    options: &DetectOptions,
    min_score: f64,
) -> Vec<Found> {
    let mut heads: Vec<Candidate> = Vec::new();
    for pass in 0..scales.len() {
        let of_pass = candidates.iter().filter(|c| c.pass == pass).copied().collect();
        heads.extend(groups(of_pass, options).iter().map(|group| {
            let Candidate { score, class, pass, .. } = group[0];
            Candidate { bbox: mean_box(group), score, class, pass }
        }));
    }
    heads.retain(|head| judges(&head.bbox, scales).contains(&head.pass));
    let mut found: Vec<Found> = groups(heads, options)
        .into_iter()
        .map(|mut group| {
            let judges = judges(&group[0].bbox, scales);
            group.retain(|candidate| judges.contains(&candidate.pass));
            let best_of = |pass: usize| {
                group.iter().filter(|c| c.pass == pass).map(|c| c.score).fold(0.0_f64, f64::max)
            };
            let score = judges.clone().map(best_of).sum::<f64>() / judges.len() as f64;
            Found { bbox: mean_box(&group), score, class: joint_class(&group) }
        })
        .filter(|f| f.score >= min_score && f.bbox[2] - f.bbox[0] >= options.min_width_px)
        .collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found
}

/// Returns the passes that are suited to a vehicle of this size. They are the finest two passes in which the vehicle is
/// not too large. If the vehicle is too small in the coarser of the two, this pass is left out. If the vehicle is too
/// large for all passes, only the coarsest pass is suited.
fn judges([x0, y0, x1, y1]: &[f64; 4], scales: &[f64]) -> std::ops::Range<usize> {
    let size_px = ((x1 - x0) * (y1 - y0)).max(0.0).sqrt();
    let fitting = scales.iter().take_while(|&scale| size_px * scale <= LARGEST_PX).count().max(1);
    let coarser = fitting.saturating_sub(2);
    let too_small = fitting - coarser == 2 && size_px * scales[coarser] < SMALLEST_PX;
    coarser + usize::from(too_small)..fitting
}

/// Groups boxes that show the same vehicle, best group first. The box with the highest score is the head of its group.
/// A box that shows the head's vehicle but differs too much from the head is dropped.
fn groups(mut boxes: Vec<Candidate>, options: &DetectOptions) -> Vec<Vec<Candidate>> {
    // Ties are broken by position, so that the result does not depend on the order of the boxes.
    boxes.sort_by(|a, b| {
        b.score.total_cmp(&a.score).then_with(|| a.bbox[0].total_cmp(&b.bbox[0])).then(a.pass.cmp(&b.pass))
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
            options.min_score,
        );
        assert_eq!(found.len(), 2);
        assert!((found[0].bbox[0] - 4.0 / 3.0).abs() < 1e-9 && (found[0].score - 0.8).abs() < 1e-9);
        assert!((found[1].bbox[0] - 70.0).abs() < 1e-9);
    }

    #[test]
    fn passes_judge_vehicles_of_their_size() {
        let scales = [0.25, 0.5, 1.0];
        let square = |side: f64| [0.0, 0.0, side, side];
        assert_eq!(judges(&square(30.0), &scales), 2..3, "too small for the others");
        assert_eq!(judges(&square(100.0), &scales), 1..3);
        assert_eq!(judges(&square(200.0), &scales), 0..2, "too large for the finest");
        assert_eq!(judges(&square(400.0), &scales), 0..1);
        assert_eq!(judges(&square(4000.0), &scales), 0..1, "too large for all");
        assert_eq!(judges(&square(4.0), &[1.0]), 0..1);
    }

    #[test]
    fn passes_that_should_have_detected_a_vehicle_count() {
        let options = DetectOptions { min_score: 0.05, ..DetectOptions::default() };
        let scales = [0.5, 1.0];
        let medium = [0.0, 0.0, 100.0, 100.0]; // 50 and 100 px for the net: both judge
        let small = [200.0, 0.0, 240.0, 40.0]; // 20 and 40 px: the fine pass judges
        let large = [300.0, 0.0, 600.0, 300.0]; // 150 and 300 px: the coarse pass judges
        let found = merge(
            vec![
                candidate(medium, 0.8, 1),
                candidate(small, 0.6, 1),
                candidate(large, 0.5, 0),
                candidate(large, 0.9, 1),
            ],
            &scales,
            &options,
            options.min_score,
        );
        let scores: Vec<f64> = found.iter().map(|f| (f.score * 100.0).round()).collect();
        assert_eq!(scores, [60.0, 50.0, 40.0]);
    }

    #[test]
    fn the_class_is_a_vote() {
        let options = DetectOptions::default();
        let bbox = [0.0, 0.0, 100.0, 50.0];
        let truck = Candidate { class: VehicleClass::Truck, ..candidate(bbox, 0.6, 0) };
        let found = merge(
            vec![candidate(bbox, 0.7, 1), truck, Candidate { pass: 1, ..truck }],
            &[0.5, 1.0],
            &options,
            options.min_score,
        );
        assert_eq!((found.len(), found[0].class), (1, VehicleClass::Car), "one vote a pass");
    }

    proptest::proptest! {
        #[test]
        fn any_order_gives_the_same_result(seed in 0_u64..500) {
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
            let forward = merge(boxes.clone(), &[0.5, 1.0], &options, 0.05);
            let backward = merge(boxes.into_iter().rev().collect(), &[0.5, 1.0], &options, 0.05);
            proptest::prop_assert_eq!(&forward, &backward);
            for (i, a) in forward.iter().enumerate() {
                proptest::prop_assert!(a.bbox[2] > a.bbox[0] && (0.0..=1.0).contains(&a.score));
                proptest::prop_assert!(forward[i + 1..].iter().all(|b| a.score >= b.score));
            }
        }
    }
}
