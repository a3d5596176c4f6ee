//! The data that a report shows.

use std::collections::BTreeMap;

use image::RgbImage;
use roadplane_base::{CameraEstimate, CameraMove, TrackRow};
use roadplane_geo::Fit;

/// The data that a report shows.
#[derive(Debug)]
pub struct ReportInput<'a> {
    /// Name of the input.
    pub title: &'a str,
    /// Cameras, one per segment, in the order of time.
    pub cameras: &'a [CameraEstimate],
    /// Rows of all tracks, sorted by frame and then by track.
    pub rows: &'a [TrackRow],
    /// Frames with drawn overlays, sorted by frame. Each item is a frame's index and its picture.
    pub samples: &'a [(u64, RgbImage)],
    /// Frames to draw gates, lengths and points on, sorted by frame. The list may be empty.
    pub frames: &'a [PlainFrame<'a>],
    /// Small frames for the interactive player of the report, in the order of time. The list may be empty.
    pub stills: &'a [Still],
    /// Motion of the camera at each small frame: the first eight numbers of the matrix from pixels of the camera to pixels
    /// of the frame. `None`, or a missing item, is a frame at rest.
    pub still_motion: &'a [Option<[f64; 8]>],
    /// Small pictures of single tracks, in the order of time.
    pub views: &'a [TrackStill],
    /// Reprojection error of each pose that belongs to a track: the root mean square over the keypoints, px.
    pub reprojection_rms_px: &'a [f64],
    /// Facts about the run as pairs of name and value, such as counts, times and versions.
    pub facts: &'a [(String, String)],
    /// Warnings about the run, one sentence each.
    pub warnings: &'a [String],
    /// Picture of the background: the scene without moving objects.
    pub background: Option<&'a RgbImage>,
    /// Picture of the background with the edges of the scene; `None` if no edges determine the vertical vanishing
    /// point.
    pub scene_lines: Option<&'a RgbImage>,
    /// Camera moves, in the order of time.
    pub moves: &'a [CameraMove],
    /// Further notes on the camera, one line each, such as a note on shake or a covered lens.
    pub camera_notes: &'a [String],
    /// Sentences about parts of the input that were lost or left out.
    pub losses: &'a [String],
    /// Sections on traffic, as HTML; empty if there are none.
    pub traffic: &'a str,
    /// Position of the camera on the map; `None` if the run is not on the map.
    pub place: Option<&'a Fit>,
}

/// A frame without drawings.
#[derive(Clone, Copy, Debug)]
pub struct PlainFrame<'a> {
    /// Index of the frame, from 0.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Number of the camera's segment at this time; `None` if the camera was not estimated.
    pub segment: Option<usize>,
    /// The picture in full size.
    pub picture: &'a RgbImage,
}

/// A small frame for the interactive player of the report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Still {
    /// Presentation time of the frame, ms.
    pub time_ms: i64,
    /// The frame as the bytes of a JPEG file.
    pub jpeg: Vec<u8>,
}

/// A small picture of one track at one time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackStill {
    /// Number of the track.
    pub track: u64,
    /// The picture and its time.
    pub still: Still,
}

/// Groups rows by track number. The rows of a track stay in their order.
pub(super) fn by_track(rows: &[TrackRow]) -> BTreeMap<u64, Vec<&TrackRow>> {
    let mut tracks: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows {
        tracks.entry(row.track).or_default().push(row);
    }
    tracks
}
