//! What a report shows.

use std::collections::BTreeMap;

use image::RgbImage;
use roadplane_base::{CameraEstimate, CameraMove, TrackRow};

/// What a report shows.
#[derive(Debug)]
pub struct ReportInput<'a> {
    /// Name of the input.
    pub title: &'a str,
    /// The camera, per stretch of time.
    pub cameras: &'a [CameraEstimate],
    /// All rows, by frame, then by track.
    pub rows: &'a [TrackRow],
    /// Frames with overlays already drawn, by index.
    pub samples: &'a [(u64, RgbImage)],
    /// Small frames to play, by time; none for a page that holds none.
    pub stills: &'a [Still],
    /// Cut-outs of tracks over their lives, by time.
    pub views: &'a [TrackStill],
    /// Reprojection errors of the tracked poses, px.
    pub reprojection_rms_px: &'a [f64],
    /// Lines of name and value: counts, times, versions.
    pub facts: &'a [(String, String)],
    /// What a reader should know.
    pub warnings: &'a [String],
    /// The place without what moves.
    pub background: Option<&'a RgbImage>,
    /// The place with the lines that tell its vertical, where there are any.
    pub scene_lines: Option<&'a RgbImage>,
    /// When the camera was moved.
    pub moves: &'a [CameraMove],
    /// What else the pictures say of the camera, a line each: shake, nothing to see.
    pub camera_notes: &'a [String],
    /// What was lost, left out or never looked at, a sentence each.
    pub losses: &'a [String],
}

/// A small frame to look at while playing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Still {
    /// Presentation time, ms.
    pub time_ms: i64,
    /// The picture.
    pub jpeg: Vec<u8>,
}

/// A track's cut-out at some time of its life.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackStill {
    /// The track.
    pub track: u64,
    /// What was seen of it, and when.
    pub still: Still,
}

/// Rows of each track, in their order.
pub(super) fn by_track(rows: &[TrackRow]) -> BTreeMap<u64, Vec<&TrackRow>> {
    let mut tracks: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows {
        tracks.entry(row.track).or_default().push(row);
    }
    tracks
}
