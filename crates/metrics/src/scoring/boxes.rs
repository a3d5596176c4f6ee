//! Boxes of a frame as average precision wants them.

use crate::average_precision::{FoundBox, PictureBoxes, TrueBox};
use crate::truth::{TrueCar, TrueFrame, Truth};

use super::counts;

/// True boxes of cars (visible parts) and the boxes found. Cars that do not count and other vehicles are ignored: nobody is
/// asked to find them, nobody is blamed for it.
#[must_use]
pub fn picture_boxes(truth: &Truth, frame: &TrueFrame, found: Vec<FoundBox>) -> PictureBoxes {
    let true_box = |car: &TrueCar| {
        TrueBox::new(car.bbox_px, !truth.model(car.id).is_some_and(|model| counts(car, model)))
    };
    PictureBoxes { truth: frame.cars.iter().map(true_box).collect(), found }
}
