//! Compares results with the truth: pairs estimates with true cars, and computes the errors of each pair.

mod boxes;
mod boxes3d;
mod poses;
mod tracks;

pub use boxes::picture_boxes;
pub use boxes3d::{body_centre_m, score_box};
pub use poses::{PoseScore, score_pose, score_poses};
pub use tracks::{TrackScore, score_tracks};

use std::collections::BTreeMap;

use roadplane_base::{VehicleClass, assign, bbox_iou};

use crate::truth::{Model, TrueCar};

/// Least visible share of a car that is scored, 0–1.
pub const MIN_VISIBLE_SHARE: f64 = 0.3;
/// Least length of the longer side of a scored car's box, px. The box encloses the visible part of the car.
pub const MIN_SIDE_PX: f64 = 24.0;
/// Least IoU of two boxes that may belong to one car.
const MIN_IOU: f64 = 0.5;

/// Returns whether a true car is scored: it is of the class car, and enough of it is visible ([`is_seen`]). Other
/// vehicles are never misses, and detections of them are no false alarms.
#[must_use]
pub fn counts(car: &TrueCar, model: &Model) -> bool {
    model.class == VehicleClass::Car && is_seen(car)
}

/// Returns whether enough of a vehicle of any class is visible to expect a detection. The limits are
/// [`MIN_VISIBLE_SHARE`] and [`MIN_SIDE_PX`].
#[must_use]
pub fn is_seen(vehicle: &TrueCar) -> bool {
    let [x0, y0, x1, y1] = vehicle.bbox_px;
    vehicle.visible_share >= MIN_VISIBLE_SHARE && (x1 - x0).max(y1 - y0) >= MIN_SIDE_PX
}

/// Returns the index of the true car that each box belongs to, or `None`. The assignment prefers pairs with a high IoU.
///
/// A box is compared with the box of the car's visible part and with the box of the whole car. The higher IoU is used,
/// because the boxes of interpolated rows enclose the whole car.
///
/// The assignment uses only boxes in the picture. So an estimate with a large error in 3D is still compared with its
/// own car.
#[must_use]
pub fn pairs_by_box(boxes_px: &[[f64; 4]], cars: &[&TrueCar]) -> Vec<Option<usize>> {
    assign(boxes_px.len(), cars.len(), 1.0 - MIN_IOU, |i, j| {
        let overlap = |truth: &[f64; 4]| bbox_iou(&boxes_px[i], truth);
        1.0 - overlap(&cars[j].bbox_px).max(overlap(&cars[j].whole_bbox_px))
    })
}

/// Returns the most frequent value. If several values are equally frequent, returns the smallest of these values.
#[must_use]
pub fn most_frequent<T: Ord + Copy>(values: impl Iterator<Item = T>) -> Option<T> {
    let mut counts: BTreeMap<T, usize> = BTreeMap::new();
    values.for_each(|value| *counts.entry(value).or_default() += 1);
    counts.into_iter().rev().max_by_key(|(_, count)| *count).map(|(value, _)| value)
}
