//! Runs the nets on labelled images.

use image::RgbImage;
use roadplane_base::{CarRecord, Frame, FrameStamp, KeypointSet, assign, bbox_iou};
use roadplane_detect::Detector;
use roadplane_keypoints::KeypointNet;
use roadplane_pipeline::PipelineError;

use super::labels::LabelledCar;

/// Least overlap (IoU) of a detected box with a labelled car's box.
const MIN_IOU: f64 = 0.4;

/// Predicts the keypoints of the labelled cars of a picture, in their true boxes or, with a `detector`, in detected
/// boxes.
///
/// The result has `None` for cars that were not found or are too small for the net.
///
/// # Errors
/// [`PipelineError`] when a net fails.
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

/// Returns the detected box of each labelled car, of any class, by the assignment with the largest overlap.
fn matched(cars: &[LabelledCar], found: &[CarRecord]) -> Vec<Option<CarRecord>> {
    let cost = |i: usize, j: usize| 1.0 - bbox_iou(&cars[i].bbox_px, &found[j].bbox_px);
    let chosen = assign(cars.len(), found.len(), 1.0 - MIN_IOU, cost);
    chosen.into_iter().map(|j| j.map(|j| CarRecord::boxed(found[j].bbox_px))).collect()
}
