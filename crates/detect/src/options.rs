//! How to look and what to believe.

use serde::{Deserialize, Serialize};

use crate::DetectError;

/// How to look and what to believe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectOptions {
    /// Lowest score that counts, 0–1.
    pub min_score: f64,
    /// Narrower boxes are left out, px of the frame.
    pub min_width_px: f64,
    /// Passes over the frame: by how much it is scaled in each. The net finds cars of about 30 to 400 px after scaling;
    /// time grows with the square.
    pub scales: Vec<f64>,
    /// Boxes that overlap more than this (intersection over union) are one vehicle.
    pub nms_iou: f64,
    /// So are boxes of which more than this share lies inside the other.
    pub nms_covered: f64,
    /// Longest side of what the net sees in one run, px after scaling; bounds memory.
    pub tile_px: u32,
    /// Overlap of neighbouring tiles, px after scaling: longer vehicles are left to a coarser pass.
    pub tile_overlap_px: u32,
}

impl Default for DetectOptions {
    fn default() -> Self {
        Self {
            min_score: 0.4,
            min_width_px: 24.0,
            scales: vec![0.5, 1.0],
            nms_iou: 0.5,
            nms_covered: 0.8,
            tile_px: 1920,
            tile_overlap_px: 192,
        }
    }
}

impl DetectOptions {
    /// Refuses values that make no sense.
    ///
    /// # Errors
    /// [`DetectError::Option`] naming the first such value and its range.
    pub fn check(&self) -> Result<(), DetectError> {
        let fail = |what: &str| Err(DetectError::Option { what: what.to_owned() });
        if !(0.05..=1.0).contains(&self.min_score) {
            return fail("min_score must be 0.05 to 1");
        }
        if !(self.min_width_px.is_finite() && self.min_width_px >= 0.0) {
            return fail("min_width_px must not be negative");
        }
        let allowed = |scale: &f64| (0.05..=4.0).contains(scale);
        if self.scales.is_empty() || self.scales.len() > 8 || !self.scales.iter().all(allowed) {
            return fail("scales must be 1 to 8 numbers of 0.05 to 4");
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
