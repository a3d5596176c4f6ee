//! Runs the keypoint net, and optionally the detector, on labelled images.

use image::RgbImage;
use roadplane_base::{CarRecord, Frame, FrameStamp, KeypointSet, assign, bbox_iou};
use roadplane_detect::Detector;
use roadplane_keypoints::KeypointNet;
use roadplane_pipeline::PipelineError;

use super::labels::LabelledCar;

/// Least overlap (IoU) at which a detected box is matched with a labelled car's box.
const MIN_IOU: f64 = 0.4;

/// Predicts the keypoints of the labelled cars of a picture.
///
/// The keypoint net gets the boxes of a `detector` if there is one, otherwise the labelled boxes.
///
/// The result has one entry per labelled car: `None` if the car was not detected or is too small for the net.
///
/// # Errors
/// [`PipelineError`] if a net fails.
pub fn predict(
    picture: RgbImage,
    cars: &[LabelledCar],
    net: &mut KeypointNet,
    detector: Option<&mut Detector>,
) -> Result<Vec<Option<KeypointSet>>, PipelineError> {
    let frame = Frame { stamp: FrameStamp { index: 0, pts_nanos: 0 }, image: picture };
    let mut records: Vec<Option<CarRecord>> = match detector {
        None => cars.iter().map(|car| Some(CarRecord::boxed(car.bbox_px))).collect(),
        Some(detector) => matched(cars, &detector.detect(&frame)?),
    };
    let mut located: Vec<CarRecord> = records.iter().flatten().cloned().collect();
    net.locate(&frame, &mut located)?;
    let mut located = located.into_iter();
    let take = |record: &mut Option<CarRecord>| {
        record.take().and_then(|_| located.next()).and_then(|car| car.keypoints).map(|set| *set)
    };
    Ok(records.iter_mut().map(take).collect())
}

/// Returns the detected box of each labelled car, or `None` if no box matches.
///
/// The assignment has the largest total overlap. Detected boxes of all classes take part.
fn matched(cars: &[LabelledCar], found: &[CarRecord]) -> Vec<Option<CarRecord>> {
    let cost = |i: usize, j: usize| 1.0 - bbox_iou(&cars[i].bbox_px, &found[j].bbox_px);
    let chosen = assign(cars.len(), found.len(), 1.0 - MIN_IOU, cost);
    chosen.into_iter().map(|j| j.map(|j| CarRecord::boxed(found[j].bbox_px))).collect()
}
