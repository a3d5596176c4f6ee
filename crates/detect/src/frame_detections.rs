//! What one look came to, over all the parts of the picture that the net ran on.

use roadplane_base::{CarRecord, bbox_centre, bbox_share_inside};
use roadplane_watch::Cells;

use crate::DetectOptions;
use crate::detector::{Detections, record};

/// A core must hold this share of a box to have looked at it as a whole.
const HELD: f64 = 0.9;

/// Boxes in px of the frame.
#[derive(Debug)]
pub(crate) struct FrameDetections {
    options: DetectOptions,
    cores: Vec<[f64; 4]>,
    /// What the cores cover.
    pub looked: Cells,
    /// Where a vehicle may be: weak boxes say so too.
    pub vehicles: Cells,
    /// Vehicles that count, each once.
    pub found: Vec<CarRecord>,
    /// Boxes that the border of what was looked at cut.
    pub cut: Vec<[f64; 4]>,
}

impl FrameDetections {
    /// Before anything was looked at, in this grid.
    pub(crate) fn new(options: &DetectOptions, grid: &Cells) -> Self {
        let (looked, vehicles) = (grid.emptied(), grid.emptied());
        Self {
            options: options.clone(),
            cores: Vec::new(),
            looked,
            vehicles,
            found: Vec::new(),
            cut: Vec::new(),
        }
    }

    /// What the net saw in a part of a picture of this width and height; `cores` are what of the part counts as looked at.
    pub(crate) fn add(&mut self, detections: Detections, cores: Vec<[f64; 4]>, (width, height): (f64, f64)) {
        cores.iter().for_each(|core| self.looked.insert_box(core));
        self.cores.extend(cores);
        let min_score = self.options.min_score;
        self.cut.extend(detections.cut.iter().filter(|cut| cut.score >= min_score).map(|cut| cut.bbox));
        for one in detections.found {
            self.vehicles.insert_box(&one.bbox);
            if one.score >= min_score
                && let Some(record) = record(one, width, height)
                && !self.has(&record.bbox_px)
            {
                self.found.push(record);
            }
        }
    }

    /// Whether a vehicle was found there.
    fn has(&self, bbox: &[f64; 4]) -> bool {
        self.found.iter().any(|other| self.options.are_one(&other.bbox_px, bbox))
    }

    /// Whether a box was looked at as a whole.
    pub(crate) fn cover(&self, bbox: &[f64; 4]) -> bool {
        let centre = bbox_centre(bbox);
        self.cores.iter().any(|core| {
            let [x0, y0, x1, y1] = *core;
            (x0..=x1).contains(&centre.x)
                && (y0..=y1).contains(&centre.y)
                && bbox_share_inside(bbox, core) >= HELD
        })
    }
}
