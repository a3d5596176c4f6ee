//! Converts the boxes of a frame to the input of the average precision.

use crate::average_precision::{FoundBox, PictureBoxes, TrueBox};
use crate::truth::{TrueCar, TrueFrame, Truth};

use super::counts;

/// Returns the true boxes of a frame (visible parts only) with the detections. Cars that [`counts`] rejects, and other
/// vehicles, are ignored: they are neither misses nor false alarms.
#[must_use]
pub fn picture_boxes(truth: &Truth, frame: &TrueFrame, found: Vec<FoundBox>) -> PictureBoxes {
    let true_box = |car: &TrueCar| {
        TrueBox::new(car.bbox_px, !truth.model(car.id).is_some_and(|model| counts(car, model)))
    };
    PictureBoxes { truth: frame.cars.iter().map(true_box).collect(), found }
}
