//! The content of a report.

use std::collections::BTreeMap;

use image::RgbImage;
use roadplane_base::{CameraEstimate, CameraMove, TrackRow};

/// The content of a report.
#[derive(Debug)]
pub struct ReportInput<'a> {
    /// Name of the input.
    pub title: &'a str,
    /// Cameras, one per segment, in the order of time.
    pub cameras: &'a [CameraEstimate],
    /// All rows, sorted by frame and track.
    pub rows: &'a [TrackRow],
    /// Frames with overlays drawn, each with its index, in the order of the index.
    pub samples: &'a [(u64, RgbImage)],
    /// Small frames for the player, in the order of time; may be empty.
    pub stills: &'a [Still],
    /// Cut-outs of tracks, in the order of time.
    pub views: &'a [TrackStill],
    /// Reprojection errors of the tracked poses, px.
    pub reprojection_rms_px: &'a [f64],
    /// Pairs of name and value: counts, times, versions.
    pub facts: &'a [(String, String)],
    /// Warnings, one sentence each.
    pub warnings: &'a [String],
    /// Background: the scene without moving objects.
    pub background: Option<&'a RgbImage>,
    /// Background with the edges that determine the vertical vanishing point, if there are any.
    pub scene_lines: Option<&'a RgbImage>,
    /// Camera moves, in the order of time.
    pub moves: &'a [CameraMove],
    /// Further notes on the camera, one line each: shake, covered lens.
    pub camera_notes: &'a [String],
    /// Losses: parts of the input that were lost or left out, one sentence each.
    pub losses: &'a [String],
}

/// A small frame for the player.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Still {
    /// Presentation time, ms.
    pub time_ms: i64,
    /// Content of the JPEG file.
    pub jpeg: Vec<u8>,
}

/// A cut-out of a track at one time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackStill {
    /// Number of the track.
    pub track: u64,
    /// The cut-out, with its time.
    pub still: Still,
}

/// Groups rows by track and keeps their order.
pub(super) fn by_track(rows: &[TrackRow]) -> BTreeMap<u64, Vec<&TrackRow>> {
    let mut tracks: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows {
        tracks.entry(row.track).or_default().push(row);
    }
    tracks
}
