//! Options of the detector.

use roadplane_base::{bbox_covered, bbox_iou};
use serde::{Deserialize, Serialize};

use crate::DetectError;

/// Largest factor by which the fine pass enlarges a frame. A larger factor adds no detail.
const MAX_ENLARGEMENT: f64 = 2.0;

/// Options of the detector: passes, thresholds and merging.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectOptions {
    /// Lowest score of a detection, 0–1.
    pub min_score: f64,
    /// Smallest width of a box, px of the frame.
    pub min_width_px: f64,
    /// Length of the frame's longer side in each pass, px. Frames are never enlarged. The net was trained on vehicles of
    /// 16 to 300 px after scaling. The computing time grows with the square of the length.
    pub pass_px: Vec<u32>,
    /// Length of the frame's longer side in the pass that finds small vehicles, px; 0 for none. It enlarges frames at most
    /// twice. In a clip, it runs only on the rows where vehicles are small.
    pub fine_px: u32,
    /// Two boxes show one vehicle if their overlap (intersection over union) is at least this value.
    pub nms_iou: f64,
    /// Two boxes show one vehicle if at least this share of the smaller box lies inside the other box.
    pub nms_covered: f64,
    /// Longest side of the net's input in one run, px after scaling. This limit bounds the memory use.
    pub tile_px: u32,
    /// Overlap of neighbouring tiles, px after scaling. Vehicles that are longer than the overlap are left to a coarser
    /// pass.
    pub tile_overlap_px: u32,
}

/// The pass that finds small vehicles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FinePass {
    /// Factor by which it scales a frame.
    pub scale: f64,
    /// Distance between two inference frames with this pass. The pass then costs no more than all others together.
    pub every: u64,
}

impl Default for DetectOptions {
    fn default() -> Self {
        Self {
            min_score: 0.44,
            min_width_px: 16.0,
            pass_px: vec![640, 1280],
            fine_px: 1920,
            nms_iou: 0.5,
            nms_covered: 0.9,
            tile_px: 1920,
            tile_overlap_px: 192,
        }
    }
}

impl DetectOptions {
    /// Returns the factor by which each pass scales a frame, coarsest first. Passes with nearly equal factors are
    /// merged.
    pub(crate) fn scales(&self, width: u32, height: u32) -> Vec<f64> {
        let longer = f64::from(width.max(height).max(1));
        let mut scales: Vec<f64> = self.pass_px.iter().map(|&px| (f64::from(px) / longer).min(1.0)).collect();
        scales.sort_by(f64::total_cmp);
        scales.dedup_by(|a, b| (*a / *b - 1.0).abs() < 0.02);
        scales
    }

    /// Returns the fine pass for a frame of this size; `None` if it shows no more than the other passes.
    pub(crate) fn fine(&self, width: u32, height: u32) -> Option<FinePass> {
        let scale = (f64::from(self.fine_px) / f64::from(width.max(height).max(1))).min(MAX_ENLARGEMENT);
        let scales = self.scales(width, height);
        let others: f64 = scales.iter().map(|scale| scale.powi(2)).sum();
        let finest = scales.last().copied().unwrap_or_default();
        (scale > 1.02 * finest).then(|| FinePass { scale, every: (scale.powi(2) / others).ceil() as u64 })
    }

    /// Returns the number of pixels of the net's input for a picture of this size, summed over all passes but the fine
    /// one.
    #[must_use]
    pub fn input_px(&self, width: u32, height: u32) -> f64 {
        let scales = self.scales(width, height);
        scales.iter().map(|scale| scale * scale * f64::from(width) * f64::from(height)).sum()
    }

    /// Whether two boxes show one vehicle.
    pub(crate) fn are_one(&self, a: &[f64; 4], b: &[f64; 4]) -> bool {
        bbox_iou(a, b) >= self.nms_iou || bbox_covered(a, b) >= self.nms_covered
    }

    /// Checks the ranges of the options.
    ///
    /// # Errors
    /// [`DetectError::Option`] with the name and the range of the first option that is out of its range.
    pub fn check(&self) -> Result<(), DetectError> {
        let fail = |what: &str| Err(DetectError::Option { what: what.to_owned() });
        if !(0.05..=1.0).contains(&self.min_score) {
            return fail("min_score must be 0.05 to 1");
        }
        if !(self.min_width_px.is_finite() && self.min_width_px >= 0.0) {
            return fail("min_width_px must not be negative");
        }
        let allowed = |px: &u32| (160..=8192).contains(px);
        if self.pass_px.is_empty() || self.pass_px.len() > 8 || !self.pass_px.iter().all(allowed) {
            return fail("pass_px must be 1 to 8 numbers of 160 to 8192");
        }
        if self.fine_px != 0 && !allowed(&self.fine_px) {
            return fail("fine_px must be 0 or 160 to 8192");
        }
        if !(0.1..=1.0).contains(&self.nms_iou) || !(0.1..=1.0).contains(&self.nms_covered) {
            return fail("nms_iou and nms_covered must be 0.1 to 1");
        }
        if !(256..=8192).contains(&self.tile_px) || self.tile_overlap_px * 2 > self.tile_px {
            return fail("tile_px must be 256 to 8192, tile_overlap_px at most half of it");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_fine_pass_enlarges_frames() {
        let options = DetectOptions { pass_px: vec![1280, 960], ..DetectOptions::default() };
        assert_eq!(options.scales(1920, 1080), [0.5, 1280.0 / 1920.0]);
        assert_eq!(options.scales(640, 480), [1.0]);
        assert!((options.input_px(640, 480) - 640.0 * 480.0).abs() < 1e-6);
        assert!((options.input_px(1920, 1080) - 960.0 * 540.0 - 1280.0 * 720.0).abs() < 1e-6);
        let fine = |px: u32| DetectOptions::default().fine(px, px / 2).map(|fine| (fine.scale, fine.every));
        assert_eq!([640, 1280, 2560, 3840].map(fine), [(2.0, 4), (1.5, 2), (0.75, 2), (0.5, 2)].map(Some));
        assert_eq!(DetectOptions { fine_px: 0, ..options.clone() }.fine(1280, 720), None);
        assert!(DetectOptions { pass_px: vec![], ..options }.check().is_err());
        assert!(DetectOptions::default().check().is_ok());
    }
}
