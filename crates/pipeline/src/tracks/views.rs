//! The part of the world picture that each frame of a moving camera shows.

use std::collections::BTreeMap;

use roadplane_base::{FrameRecord, Homography, ImageSize};

/// Mapping from pixels of the world picture to pixels of a frame, by frame index. Frames that are not displaced are
/// missing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Views(BTreeMap<u64, Homography>);

impl Views {
    /// Adds a frame, as `calibrate::OneCamera` returns it.
    pub(crate) fn add(&mut self, frame: &FrameRecord) {
        if let Some(picture_from_world) = frame.watch.as_ref().and_then(|watch| watch.picture_from_world) {
            self.0.insert(frame.frame, picture_from_world);
        }
    }

    /// Returns the picture of a frame as a box in the world picture, px.
    pub(crate) fn picture_px(&self, frame: u64, size: ImageSize) -> [f64; 4] {
        let whole = size.picture_px();
        self.0
            .get(&frame)
            .map_or(whole, |picture_from_world| picture_from_world.inverse().apply_to_box(&whole))
    }

    /// Converts a box in the world picture to the picture of a frame, px.
    pub(crate) fn in_picture(&self, frame: u64, bbox_px: &[f64; 4]) -> [f64; 4] {
        self.0.get(&frame).map_or(*bbox_px, |picture_from_world| picture_from_world.apply_to_box(bbox_px))
    }

    /// Removes and returns all frames, in order.
    pub(crate) fn into_frames(self) -> impl Iterator<Item = (u64, Homography)> {
        self.0.into_iter()
    }
}
