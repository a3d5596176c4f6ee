//! Collects the detections of one frame from all parts of the picture on which the net ran.

use roadplane_base::{CarRecord, WeakBox, bbox_centre, bbox_share_inside};
use roadplane_watch::{Cells, View};

use crate::DetectOptions;
use crate::decode::Candidate;
use crate::detector::{Detections, record};
use crate::merge::merge;

/// Smallest share of a box that one inspected area must cover. Only then does the box count as inspected as a whole.
const WHOLE: f64 = 0.9;
/// If a larger share than this of a low-score or cut box lies inside a vehicle's box, the box shows this vehicle.
const MOSTLY: f64 = 0.5;

/// The detections of one frame. Boxes are in px of the frame, and cells belong to the keyframe of `view`.
#[derive(Debug)]
pub(crate) struct FrameDetections {
    options: DetectOptions,
    view: View,
    cores: Vec<[f64; 4]>,
    /// Boxes that are not merged yet.
    candidates: Vec<Candidate>,
    /// The cells that the inspected areas (`cores`) touch.
    pub inspected: Cells,
    /// The cells that boxes of any score touch. A vehicle may be in these cells.
    pub vehicles: Cells,
    /// Vehicles with a sufficient score, each listed once.
    pub found: Vec<CarRecord>,
    /// Boxes whose score is too low for a detection.
    pub weak: Vec<WeakBox>,
    /// Boxes that are cut by a border of an inspected part.
    pub cut: Vec<[f64; 4]>,
}

impl FrameDetections {
    /// Creates an empty collection for a picture. Its keyframe has the cells of `grid`.
    pub(crate) fn new(options: &DetectOptions, view: View, grid: &Cells) -> Self {
        let (inspected, vehicles) = (grid.emptied(), grid.emptied());
        Self {
            options: options.clone(),
            view,
            cores: Vec::new(),
            candidates: Vec::new(),
            inspected,
            vehicles,
            found: Vec::new(),
            weak: Vec::new(),
            cut: Vec::new(),
        }
    }

    /// Adds the detections in a part of the picture. Only the areas `cores` of this part count as inspected.
    pub(crate) fn add(&mut self, detections: Detections, cores: Vec<[f64; 4]>) {
        cores.iter().for_each(|core| self.inspected.insert_box(&self.view.in_keyframe(core)));
        self.cores.extend(cores);
        let min_score = self.options.min_score;
        self.cut.extend(detections.cut.iter().filter(|cut| cut.score >= min_score).map(|cut| cut.bbox));
        self.candidates.extend(detections.found);
    }

    /// Merges the boxes of all parts and passes. Those with a score from `weak_score` on may be vehicles. The picture's
    /// width and height are in px.
    pub(crate) fn merge(&mut self, weak_score: f64, (width, height): (f64, f64)) {
        for one in merge(std::mem::take(&mut self.candidates), &self.options, weak_score) {
            self.vehicles.insert_box(&self.view.in_keyframe(&one.bbox));
            let Some(record) = record(one, width, height) else { continue };
            if one.score < self.options.min_score {
                self.weak.push(WeakBox { bbox_px: record.bbox_px, score: record.score, colour_rgb: None });
            } else {
                self.found.push(record);
            }
        }
        // Another part or pass may show the whole vehicle.
        let found = &self.found;
        self.cut.retain(|cut| !found.iter().any(|car| bbox_share_inside(cut, &car.bbox_px) > MOSTLY));
    }

    /// Whether a box was inspected as a whole.
    pub(crate) fn cover(&self, bbox: &[f64; 4]) -> bool {
        let centre = bbox_centre(bbox);
        self.cores.iter().any(|core| {
            let [x0, y0, x1, y1] = *core;
            (x0..=x1).contains(&centre.x)
                && (y0..=y1).contains(&centre.y)
                && bbox_share_inside(bbox, core) >= WHOLE
        })
    }
}

/// Returns the low-score boxes that show none of the vehicles `cars`, each listed once. A box that lies mostly inside a
/// vehicle's box shows this vehicle.
pub(crate) fn weak_beside(weak: &[WeakBox], cars: &[CarRecord], options: &DetectOptions) -> Vec<WeakBox> {
    let mut beside: Vec<WeakBox> = Vec::new();
    for weak in weak {
        let is_one = |other: &[f64; 4]| options.are_one(other, &weak.bbox_px);
        let is_car =
            |car: &CarRecord| is_one(&car.bbox_px) || bbox_share_inside(&weak.bbox_px, &car.bbox_px) > MOSTLY;
        if !cars.iter().any(is_car) && !beside.iter().any(|other| is_one(&other.bbox_px)) {
            beside.push(*weak);
        }
    }
    beside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weak_boxes_show_other_things_than_the_vehicles_found() {
        let weak =
            |x0: f64, x1: f64| WeakBox { bbox_px: [x0, 100.0, x1, 150.0], score: 0.2, colour_rgb: None };
        // The list contains one object twice, the vehicle, more than half of the vehicle, and an object that the
        // vehicle hides a little.
        let all = [
            weak(400.0, 480.0),
            weak(410.0, 490.0),
            weak(105.0, 190.0),
            weak(60.0, 145.0),
            weak(30.0, 120.0),
        ];
        let found = [CarRecord::boxed([100.0, 90.0, 180.0, 160.0])];
        let beside = weak_beside(&all, &found, &DetectOptions::default());
        assert_eq!(beside, [weak(400.0, 480.0), weak(30.0, 120.0)]);
    }
}
