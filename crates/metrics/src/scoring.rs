//! Scores of results against truth: pairing of estimates with true cars, and the errors of each pair.

mod boxes;
mod boxes3d;
mod poses;
mod tracks;

pub use boxes::picture_boxes;
pub use boxes3d::{body_centre_m, score_box};
pub use poses::{PoseScore, score_pose, score_poses};
pub use tracks::{TrackScore, score_tracks};

use roadplane_base::{VehicleClass, assign, bbox_iou};

use crate::truth::{Model, TrueCar};

/// Least visible share of a car that counts.
pub const MIN_VISIBLE_SHARE: f64 = 0.3;
/// Least longer side of the box of the visible part of a car that counts, px.
pub const MIN_SIDE_PX: f64 = 24.0;
/// Boxes with a smaller IoU belong to different cars.
const MIN_IOU: f64 = 0.5;

/// Returns whether a true car counts. Other cars are neither missed nor wrongly found.
#[must_use]
pub fn counts(car: &TrueCar, model: &Model) -> bool {
    model.class == VehicleClass::Car && is_seen(car)
}

/// Returns whether enough of a vehicle of any class is visible for it to be found.
#[must_use]
pub fn is_seen(vehicle: &TrueCar) -> bool {
    let [x0, y0, x1, y1] = vehicle.bbox_px;
    vehicle.visible_share >= MIN_VISIBLE_SHARE && (x1 - x0).max(y1 - y0) >= MIN_SIDE_PX
}

/// Returns the true car of each box, by the greatest IoU with its visible part or its whole box (a filled-in box
/// encloses the whole car).
///
/// Only the picture decides, so a large error in 3D cannot remove its own pair.
#[must_use]
pub fn pairs_by_box(boxes_px: &[[f64; 4]], cars: &[&TrueCar]) -> Vec<Option<usize>> {
    assign(boxes_px.len(), cars.len(), 1.0 - MIN_IOU, |i, j| {
        let overlap = |truth: &[f64; 4]| bbox_iou(&boxes_px[i], truth);
        1.0 - overlap(&cars[j].bbox_px).max(overlap(&cars[j].whole_bbox_px))
    })
}
