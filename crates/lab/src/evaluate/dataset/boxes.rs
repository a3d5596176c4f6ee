//! Runs the detector on the stills of a data set.

use roadplane_base::VehicleClass;
use roadplane_detect::Detector;
use roadplane_pipeline::{Config, PipelineError, open_input};

use crate::LabError;
use roadplane_metrics::average_precision::{FoundBox, PictureBoxes};
use roadplane_metrics::scoring::picture_boxes;
use roadplane_metrics::truth::Truth;

/// Detects the cars in the first frame of an item and returns the true and the found boxes.
///
/// Returns `None` if the item has no picture.
pub(super) fn detect(
    truth: &Truth,
    detector: &mut Detector,
    config: &Config,
) -> Result<Option<PictureBoxes>, LabError> {
    let (Some(media), Some(first)) = (&truth.media, truth.frames.first()) else { return Ok(None) };
    let mut input = open_input(media, config)?;
    let Some(frame) = input.next_frame().map_err(PipelineError::from)? else { return Ok(None) };
    let found = detector.detect(&frame).map_err(PipelineError::from)?;
    let cars = found.iter().filter(|found| found.class == VehicleClass::Car);
    let boxes = cars.map(|car| FoundBox { bbox_px: car.bbox_px, score: car.score }).collect();
    Ok(Some(picture_boxes(truth, first, boxes)))
}
