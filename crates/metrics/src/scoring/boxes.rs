//! The boxes of a frame as the input of the average precision.

use crate::average_precision::{FoundBox, PictureBoxes, TrueBox};
use crate::truth::{TrueCar, TrueFrame, Truth};

use super::counts;

/// Returns the true boxes of cars (visible parts) and the found boxes. Cars that do not count, and other vehicles, are
/// ignored: they are neither misses nor false alarms.
#[must_use]
pub fn picture_boxes(truth: &Truth, frame: &TrueFrame, found: Vec<FoundBox>) -> PictureBoxes {
    let true_box = |car: &TrueCar| {
        TrueBox::new(car.bbox_px, !truth.model(car.id).is_some_and(|model| counts(car, model)))
    };
    PictureBoxes { truth: frame.cars.iter().map(true_box).collect(), found }
}
