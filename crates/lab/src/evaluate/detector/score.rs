//! Matches detections to the true vehicles of a set of pictures.

use roadplane_base::{CarRecord, VehicleClass, bbox_iou};
use roadplane_metrics::average_precision::FoundBox;
use roadplane_metrics::detection_curve::{DetectionCurve, IgnoredRegion, JudgedPicture};

use super::pictures::{Labelled, PictureSet};

/// Overlaps (IoU) from which a detection finds a vehicle: of AP50 and of AP70.
pub const LEAST_IOUS: [f64; 2] = [0.5, 0.7];

/// The scored detections of a set.
#[derive(Clone, Debug)]
pub struct Scored {
    /// Detections of each picture, matched at each of [`LEAST_IOUS`].
    pub judged: Vec<[JudgedPicture; 2]>,
    /// True vehicles of each picture that are wide enough.
    pub vehicles: Vec<Vec<Labelled>>,
    detections: Vec<Vec<CarRecord>>,
}

/// Scores detections. Vehicles of other classes than `classes` are ignored. Vehicles that are narrower than
/// `min_width_px` are ignored too, and so are narrower boxes that find no vehicle.
pub fn score(
    set: &PictureSet,
    found: &[Vec<CarRecord>],
    classes: &[VehicleClass],
    min_width_px: f64,
) -> Scored {
    let is_wide = |bbox_px: &[f64; 4]| bbox_px[2] - bbox_px[0] >= min_width_px;
    let mut scored = Scored { judged: Vec::new(), vehicles: Vec::new(), detections: found.to_vec() };
    for (picture, found) in set.pictures.iter().zip(found) {
        let counts = |vehicle: &Labelled| {
            is_wide(&vehicle.bbox_px) && vehicle.class.is_none_or(|class| classes.contains(&class))
        };
        let (wide, others): (Vec<Labelled>, Vec<Labelled>) =
            picture.vehicles.iter().cloned().partition(counts);
        let mut ignored = picture.ignored.clone();
        ignored.extend(others.iter().map(|vehicle| IgnoredRegion::at_half(vehicle.bbox_px)));
        let truth: Vec<[f64; 4]> = wide.iter().map(|vehicle| vehicle.bbox_px).collect();
        let boxes: Vec<FoundBox> =
            found.iter().map(|car| FoundBox { bbox_px: car.bbox_px, score: car.score }).collect();
        scored.judged.push(LEAST_IOUS.map(|least| {
            let mut judged = JudgedPicture::of(&truth, &ignored, &boxes, least);
            judged.judged.retain(|j| j.vehicle.is_some() || is_wide(&boxes[j.detection].bbox_px));
            judged
        }));
        scored.vehicles.push(wide);
    }
    scored
}

/// A true vehicle, and its detection from a score on.
pub struct Case<'a> {
    /// Index of the picture.
    pub picture: usize,
    /// The true vehicle.
    pub vehicle: &'a Labelled,
    /// Overlap (IoU) and class of its detection; `None` if it was missed.
    pub found: Option<(f64, VehicleClass)>,
}

impl Scored {
    /// Returns the curve over all pictures, at IoU 0.5.
    pub fn curve(&self) -> DetectionCurve {
        DetectionCurve::of(&self.judged.iter().map(|[at_half, _]| at_half).collect::<Vec<_>>())
    }

    /// Returns every true vehicle with its detection at IoU 0.5 from `least_score` on.
    pub fn cases(&self, least_score: f64) -> Vec<Case<'_>> {
        let mut cases = Vec::new();
        for (picture, vehicles) in self.vehicles.iter().enumerate() {
            let judged = &self.judged[picture][0].judged;
            for (number, vehicle) in vehicles.iter().enumerate() {
                let found = judged.iter().find(|j| j.vehicle == Some(number) && j.score >= least_score);
                let found = found.map(|j| {
                    let car = &self.detections[picture][j.detection];
                    (bbox_iou(&car.bbox_px, &vehicle.bbox_px), car.class)
                });
                cases.push(Case { picture, vehicle, found });
            }
        }
        cases
    }

    /// Returns the missed vehicles and the false boxes of a picture from `least_score` on, px.
    pub fn errors(&self, picture: usize, least_score: f64) -> (Vec<[f64; 4]>, Vec<[f64; 4]>) {
        let kept = || self.judged[picture][0].judged.iter().filter(|j| j.score >= least_score);
        let missed = self.vehicles[picture].iter().enumerate();
        let missed = missed.filter(|(number, _)| kept().all(|j| j.vehicle != Some(*number)));
        let wrong =
            kept().filter(|j| j.vehicle.is_none()).map(|j| self.detections[picture][j.detection].bbox_px);
        (missed.map(|(_, vehicle)| vehicle.bbox_px).collect(), wrong.collect())
    }

    /// Returns the boxes that found a vehicle in a picture from `least_score` on, px.
    pub fn found(&self, picture: usize, least_score: f64) -> Vec<[f64; 4]> {
        let right = self.judged[picture][0].judged.iter();
        let right = right.filter(|j| j.score >= least_score && j.vehicle.is_some());
        right.map(|j| self.detections[picture][j.detection].bbox_px).collect()
    }
}
