//! The part of the world picture that each frame of a moving camera shows.

use std::collections::BTreeMap;

use roadplane_base::{FrameRecord, ImageSize, PictureMotion};
use roadplane_write::{CameraFile, FrameMotion};

/// Time of a frame, s, and the mapping from pixels of the world picture to its pixels, by frame index. Frames that are
/// not displaced are missing.
#[derive(Clone, Debug, Default)]
pub struct Views(BTreeMap<u64, (f64, PictureMotion)>);

impl Views {
    /// Adds a frame, as `calibrate::OneCamera` returns it.
    pub(crate) fn add(&mut self, frame: &FrameRecord) {
        if let Some(picture_from_world) = frame.watch.as_ref().and_then(|watch| watch.picture_from_world) {
            self.0.insert(frame.frame, (frame.time_s, picture_from_world));
        }
    }

    /// Returns the picture of a frame as a box in the world picture, px.
    pub(crate) fn picture_px(&self, frame: u64, size: ImageSize) -> [f64; 4] {
        size.part_in_view_px(self.of(frame))
    }

    /// Converts a box in the world picture to the picture of a frame, px.
    pub(crate) fn in_picture(&self, frame: u64, bbox_px: &[f64; 4]) -> [f64; 4] {
        self.of(frame).map_or(*bbox_px, |picture_from_world| picture_from_world.apply_to_box(bbox_px))
    }

    /// Returns the mapping from the world picture to the picture of a frame; `None` if it is not displaced.
    pub(crate) fn of(&self, frame: u64) -> Option<&PictureMotion> {
        self.0.get(&frame).map(|(_, picture_from_world)| picture_from_world)
    }

    /// Returns the mapping of the frame at a time, ms; `None` if it is not displaced.
    pub(crate) fn at_ms(&self, time_ms: i64) -> Option<&PictureMotion> {
        let at = self.0.values().find(|(time_s, _)| (time_s * 1e3).round() as i64 == time_ms);
        at.map(|(_, picture_from_world)| picture_from_world)
    }

    /// Adds the frames of another time chunk. Frames that both have keep their mapping.
    pub(crate) fn extend(&mut self, other: Self) {
        for (frame, view) in other.0 {
            self.0.entry(frame).or_insert(view);
        }
    }

    /// Returns the motion as `camera.json` stores it.
    #[must_use]
    pub fn to_file(&self) -> Vec<FrameMotion> {
        let motion = |(frame, (time_s, picture_from_world)): (&u64, &(f64, PictureMotion))| {
            FrameMotion::new(*frame, *time_s, &picture_from_world.homography)
        };
        self.0.iter().map(motion).collect()
    }

    /// Reads the motion of `camera.json`.
    #[must_use]
    pub fn from_file(camera: &CameraFile) -> Self {
        let view = |row: &FrameMotion| Some((row.frame, (row.time_s, camera.picture_from_world(row)?)));
        Self(camera.motion.iter().filter_map(view).collect())
    }
}
