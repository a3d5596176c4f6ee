//! Vehicles that were detected before: their expected boxes, and whether they are stationary.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::{CarRecord, VehicleClass, bbox_around, bbox_centre, bbox_iou, bbox_moved};

/// Smallest number of consecutive detections in one position that make a vehicle stationary.
const SETTLED_DETECTIONS: u32 = 5;
/// Shortest time between the first and the last detection in one position that makes a vehicle stationary, s.
const SETTLED_S: f64 = 0.35;
/// Distance that a moving vehicle must move before it is inspected again, as a share of its box's diagonal.
const MOVED: f64 = 0.12;
/// Time after which a moving vehicle is inspected again in any case, s.
const MAX_UNINSPECTED_S: f64 = 0.2;
/// Score below which a vehicle is inspected in every inference frame, because the next inspection may miss it.
const DOUBTFUL: f64 = 0.5;
/// Smallest overlap (intersection over union) between a stationary vehicle's new box and its anchor box. The anchor box
/// is the first box in the current position.
const STAYED: f64 = 0.8;
/// Smallest overlap between a stationary vehicle's new box and its anchor box if no cell changed. Without a change in
/// the picture, the vehicle cannot have moved, and only the detector's box jitters.
const STAYED_UNCHANGED: f64 = 0.5;
/// A vehicle is dropped when the weights of its misses add up to this value. A miss is an inspection without a
/// detection of the vehicle.
const MAX_MISSED: f64 = 2.0;
/// Two inspections count as independent if at least this time lies between them, s. A miss after a shorter time has a
/// proportionally smaller weight.
const ALIKE_S: f64 = 0.09;
/// Weight of a miss if no cell changed. A stationary vehicle cannot leave without a change, so the detector must have
/// overlooked it.
const MISSED_UNCHANGED: f64 = 0.25;
/// Factor by which older class votes are reduced at each detection.
const FADE: f64 = 0.97;
/// Smallest overlap (intersection over union) at which a detection can be assigned to a vehicle.
const MIN_OVERLAP: f64 = 0.2;
/// Margin around a vehicle's box that is inspected with the box, as a share of the box's sides.
const AROUND: f64 = 0.15;

/// A vehicle that was detected before. Its boxes are in px of the keyframe that the pictures show.
#[derive(Clone, Debug)]
pub(crate) struct TrackedBox {
    pub bbox_px: [f64; 4],
    pub score: f64,
    /// For each class, the sum of the scores of its detections. Older scores are reduced.
    votes: BTreeMap<VehicleClass, f64>,
    /// Frame of the last detection.
    pub seen_frame: u64,
    seen_s: f64,
    /// Box of the first detection in the current position.
    anchor_px: [f64; 4],
    anchor_s: f64,
    stayed: u32,
    /// Number of detections of the vehicle.
    detections: u32,
    missed: f64,
    /// Time of the last inspection of the vehicle's position, s.
    inspected_s: f64,
    velocity_px_s: Vector2<f64>,
}

impl TrackedBox {
    fn new(found: &CarRecord, frame: u64, time_s: f64) -> Self {
        Self {
            bbox_px: found.bbox_px,
            score: found.score,
            votes: BTreeMap::from([(found.class, found.score)]),
            seen_frame: frame,
            seen_s: time_s,
            anchor_px: found.bbox_px,
            anchor_s: time_s,
            stayed: 1,
            detections: 1,
            missed: 0.0,
            inspected_s: time_s,
            velocity_px_s: Vector2::zeros(),
        }
    }

    /// Returns the class by a vote of all detections.
    pub(crate) fn class(&self) -> VehicleClass {
        let best = self.votes.iter().reduce(|best, next| if next.1 > best.1 { next } else { best });
        best.map_or(VehicleClass::Car, |(class, _)| *class)
    }

    /// Whether the vehicle is stationary and its misses add up to less than one. Its position then needs no inspection
    /// before a change or the periodic full scan, even if the detector's score varies.
    pub(crate) fn is_settled(&self) -> bool {
        self.is_stationary() && self.missed < 1.0
    }

    /// Whether the vehicle has been in its position for long enough.
    fn is_stationary(&self) -> bool {
        self.stayed >= SETTLED_DETECTIONS && self.seen_s - self.anchor_s >= SETTLED_S
    }

    /// Whether the vehicle must be inspected. This is so if it is new, has a low score or was missed. It is also so if
    /// the vehicle has moved far enough, or was not inspected for too long.
    pub(crate) fn is_due(&self, time_s: f64) -> bool {
        let [x0, y0, x1, y1] = self.bbox_px;
        let moved = self.velocity_px_s.norm() * (time_s - self.seen_s);
        self.detections < SETTLED_DETECTIONS
            || (self.score < DOUBTFUL && !self.is_carried_over())
            || (self.missed > 0.0 && !self.is_carried_over())
            || moved >= MOVED * (x1 - x0).hypot(y1 - y0)
            || time_s - self.inspected_s >= MAX_UNINSPECTED_S
    }

    /// Whether the vehicle's box is carried over: the vehicle is stationary, and few inspections missed it.
    pub(crate) fn is_carried_over(&self) -> bool {
        self.is_stationary() && self.missed < MAX_MISSED
    }

    /// Returns the box in which the vehicle is expected at a time, s.
    pub(crate) fn expected(&self, time_s: f64) -> [f64; 4] {
        if self.is_stationary() {
            return self.bbox_px;
        }
        bbox_moved(&self.bbox_px, &(self.velocity_px_s * (time_s - self.seen_s).clamp(0.0, 0.5)))
    }

    /// Returns the box that an inspection must cover: the last box and the expected box, with a margin.
    pub(crate) fn inspection_box(&self, time_s: f64) -> [f64; 4] {
        let bbox = &self.bbox_px;
        let [x0, y0, x1, y1] = bbox_around(bbox, &self.expected(time_s));
        let (dx, dy) = (AROUND * (bbox[2] - bbox[0]), AROUND * (bbox[3] - bbox[1]));
        [x0 - dx, y0 - dy, x1 + dx, y1 + dy]
    }

    /// Updates the vehicle with a new detection. A stationary vehicle keeps its box if no cell in it changed
    /// (`unchanged`).
    fn add_detection(&mut self, found: &CarRecord, unchanged: bool, frame: u64, time_s: f64) {
        self.detections = self.detections.saturating_add(1);
        self.inspected_s = time_s;
        self.votes.values_mut().for_each(|votes| *votes *= FADE);
        *self.votes.entry(found.class).or_default() += found.score;
        let least = if unchanged { STAYED_UNCHANGED } else { STAYED };
        let stays = bbox_iou(&self.anchor_px, &found.bbox_px) >= least;
        let keeps_box = unchanged && stays && self.is_carried_over();
        let gap_s = time_s - self.seen_s;
        if !keeps_box && gap_s > 0.0 {
            self.velocity_px_s = (bbox_centre(&found.bbox_px) - bbox_centre(&self.bbox_px)) / gap_s;
        }
        if stays {
            self.stayed = self.stayed.saturating_add(1);
        } else {
            (self.anchor_px, self.anchor_s, self.stayed) = (found.bbox_px, time_s, 1);
        }
        if !keeps_box {
            self.bbox_px = found.bbox_px;
        }
        self.score = found.score;
        (self.seen_frame, self.seen_s, self.missed) = (frame, time_s, 0.0);
    }
}

/// Assigns the detections `found` of one inference frame to the tracked vehicles.
///
/// If no cell changed, the detection of a stationary vehicle gets the vehicle's earlier box. Vehicles that were missed
/// too often are dropped. Unassigned detections become new vehicles.
///
/// `covers` returns whether a box was inspected as a whole. `unchanged` returns whether no cell in a box changed.
pub(crate) fn update(
    tracked: &mut Vec<TrackedBox>,
    found: &mut [CarRecord],
    frame: u64,
    time_s: f64,
    covers: impl Fn(&[f64; 4]) -> bool,
    unchanged: impl Fn(&[f64; 4]) -> bool,
) {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (k, vehicle) in tracked.iter().enumerate() {
        let expected = vehicle.expected(time_s);
        for (f, car) in found.iter().enumerate() {
            let overlap = bbox_iou(&expected, &car.bbox_px).max(bbox_iou(&vehicle.bbox_px, &car.bbox_px));
            if overlap >= MIN_OVERLAP {
                pairs.push((overlap, k, f));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut tracked_assigned, mut found_assigned) = (vec![false; tracked.len()], vec![false; found.len()]);
    for (_, k, f) in pairs {
        if !tracked_assigned[k] && !found_assigned[f] {
            (tracked_assigned[k], found_assigned[f]) = (true, true);
            let is_unchanged = unchanged(&tracked[k].bbox_px);
            tracked[k].add_detection(&found[f], is_unchanged, frame, time_s);
            (found[f].bbox_px, found[f].class) = (tracked[k].bbox_px, tracked[k].class());
        }
    }
    for (vehicle, seen) in tracked.iter_mut().zip(&tracked_assigned) {
        if !seen && covers(&vehicle.expected(time_s)) {
            let miss = ((time_s - vehicle.inspected_s) / ALIKE_S).min(1.0);
            vehicle.missed += if unchanged(&vehicle.bbox_px) { MISSED_UNCHANGED * miss } else { miss };
            vehicle.inspected_s = time_s;
        }
    }
    tracked.retain(|vehicle| vehicle.missed < MAX_MISSED);
    tracked.extend(
        found
            .iter()
            .zip(&found_assigned)
            .filter(|(_, assigned)| !**assigned)
            .map(|(f, _)| TrackedBox::new(f, frame, time_s)),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car(x: f64) -> CarRecord {
        CarRecord::boxed([x, 100.0, x + 80.0, 150.0])
    }

    #[test]
    fn a_stationary_vehicle_settles_and_is_dropped_after_two_misses() {
        let mut tracked = Vec::new();
        for index in 0..5_u32 {
            assert!(!tracked.iter().any(TrackedBox::is_settled));
            let mut found = [car(10.0 + f64::from(index % 2))];
            update(&mut tracked, &mut found, index.into(), f64::from(index) * 0.1, |_| true, |_| false);
        }
        assert!(tracked[0].is_settled() && tracked.len() == 1);
        let mut jittering = [car(13.0)];
        update(&mut tracked, &mut jittering, 5, 0.5, |_| true, |_| true);
        assert!((jittering[0].bbox_px[0] - 10.0).abs() < 1e-9, "it keeps its box");
        let mut inspect = |frame: u64, covers: bool| {
            update(&mut tracked, &mut [], frame, frame as f64 * 0.1, |_| covers, |_| frame < 8);
            (
                tracked.len(),
                tracked.first().is_some_and(TrackedBox::is_settled),
                tracked.first().is_some_and(TrackedBox::is_carried_over),
            )
        };
        assert_eq!(inspect(6, false), (1, true, true), "not inspected");
        assert_eq!(inspect(7, true), (1, true, true), "no change: the detector missed it");
        assert_eq!(inspect(8, true), (1, false, true), "one miss may be an error of the detector");
        assert_eq!(inspect(9, true).0, 0);
    }

    #[test]
    fn a_moving_vehicle_is_expected_farther_on_and_never_settles() {
        let mut tracked = Vec::new();
        for index in 0..12_u32 {
            let mut found = [car(f64::from(index) * 20.0)];
            update(&mut tracked, &mut found, index.into(), f64::from(index) * 0.1, |_| true, |_| false);
        }
        assert!(tracked.len() == 1 && !tracked[0].is_settled());
        assert!((tracked[0].expected(1.2)[0] - 240.0).abs() < 1e-6);
        assert!(!tracked[0].is_due(1.11) && tracked[0].is_due(1.2), "20 px are much of its 94 px, 2 are not");
    }

    #[test]
    fn a_doubtful_vehicle_is_inspected_in_every_frame_and_not_dropped_sooner() {
        let doubtful = |x: f64| CarRecord { score: 0.4, ..car(x) };
        let mut tracked = Vec::new();
        for index in 0..12_u32 {
            let mut found = [doubtful(f64::from(index) * 20.0)];
            update(&mut tracked, &mut found, index.into(), f64::from(index) * 0.1, |_| true, |_| false);
        }
        assert!(tracked[0].is_due(1.11));
        let missed_for_s = (1..20)
            .map(|i| f64::from(i) / 30.0)
            .find(|gone_s| {
                update(&mut tracked, &mut [], 13, 1.1 + gone_s, |_| true, |_| false);
                tracked.is_empty()
            })
            .unwrap();
        assert!(
            (0.15..0.25).contains(&missed_for_s),
            "misses 1/30 s apart count only in part: {missed_for_s}"
        );
    }

    #[test]
    fn a_box_that_jitters_where_nothing_changes_is_stationary() {
        let mut tracked = Vec::new();
        for index in 0..6_u32 {
            let mut found = [car(if index % 2 == 0 { 10.0 } else { 26.0 })];
            update(&mut tracked, &mut found, index.into(), f64::from(index) * 0.1, |_| true, |_| true);
        }
        assert!(tracked[0].is_settled(), "two thirds of its box stayed");
    }
}
