//! Small frames and cut-outs of vehicles that the player in the report shows. They are collected while the frames of a
//! clip are read, and their size in bytes is limited. A run that was stopped, or split into pieces, collects the same
//! pictures.

use std::collections::BTreeMap;
use std::path::Path;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use image::RgbImage;
use roadplane_base::{FrameRecord, FrameStamp, TrackRow, bbox_iou};
use roadplane_view::{Still, TrackStill};
use roadplane_write::{JsonLines, read_jsonl};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::PipelineError;
use crate::stream::moments::Moments;
use crate::stream::small_picture::{compressed, shrunk};

/// Time between two small frames of a short clip, s.
const FRAME_SLOT_S: f64 = 1.0 / 3.0;
/// Time between two cut-outs of a vehicle in a short clip, s.
const CROP_SLOT_S: f64 = 2.0 / 3.0;
/// Approximate width of a small frame, px.
const FRAME_PX: u32 = 640;
/// Largest width and height of a cut-out, px.
const CROP_PX: u32 = 160;
/// JPEG quality of small frames.
const FRAME_QUALITY: u8 = 55;
/// JPEG quality of cut-outs.
const CROP_QUALITY: u8 = 70;
/// Width and height of a cut-out, as multiples of the width and height of the vehicle's box.
const AROUND: f64 = 1.2;
/// Share of the report's size, `output.report_mib`, for small frames. The static parts of the page use the space that
/// small frames and cut-outs leave.
const FRAMES_SHARE: f64 = 0.55;
/// Share of the report's size, `output.report_mib`, for cut-outs.
const CROPS_SHARE: f64 = 0.15;
/// Number of characters in the page for each byte of a picture, which the page contains as base64.
const INLINED: f64 = 4.0 / 3.0;
/// Factor by which the collected cut-outs may exceed their share of the report's size. After tracking, only some of
/// them go into the report.
const WAITING: f64 = 16.0;
/// Largest number of cut-outs of a track.
const VIEWS: usize = 12;
/// Least intersection over union of the box of a cut-out and the box of its track in the same frame.
const MIN_OVERLAP: f64 = 0.5;

/// The picture of a vehicle that is cut out of a frame.
#[derive(Clone, Debug, PartialEq)]
struct Crop {
    frame: u64,
    time_ms: i64,
    bbox_px: [f64; 4],
    jpeg: Vec<u8>,
}

/// The small frames and cut-outs that are kept for the report.
#[derive(Debug)]
pub(crate) struct Stills {
    frames: Moments<Still>,
    crops: Moments<Vec<Crop>>,
    views_bytes: u64,
}

/// Spacing in time of the small frames and cut-outs of a piece. At level n, the time between two pictures is about 2ⁿ
/// times as long as at level 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct StillLevels {
    /// Level of the small frames, 0 or more.
    frames: u32,
    /// Level of the cut-outs of vehicles, 0 or more.
    crops: u32,
}

impl Stills {
    /// Creates an empty collection for a report of about `report_mib` MiB. With 0, no picture is kept.
    pub(crate) fn new(report_mib: f64) -> Self {
        let bytes = |share: f64| (share * report_mib * f64::from(1 << 20) / INLINED) as u64;
        Self {
            frames: Moments::new(FRAME_SLOT_S, bytes(FRAMES_SHARE)),
            crops: Moments::new(CROP_SLOT_S, bytes(CROPS_SHARE * WAITING)),
            views_bytes: bytes(CROPS_SHARE),
        }
    }

    /// Receives the next picture of the clip, and keeps a small frame of it if one is due. Returns true if cut-outs are
    /// due. The caller then calls [`Self::cut`] for this picture.
    pub(crate) fn offer(&mut self, stamp: FrameStamp, image: &RgbImage) -> bool {
        if self.frames.is_due(stamp.time_s()) {
            let factor = (f64::from(image.width()) / f64::from(FRAME_PX)).round().max(1.0) as u32;
            let small = shrunk(image, [0, 0, image.width(), image.height()], factor);
            if let Some(jpeg) = compressed(&small, FRAME_QUALITY) {
                let still = Still { time_ms: time_ms(stamp), jpeg };
                self.frames.keep(stamp.time_s(), still.jpeg.len() as u64, still);
            }
        }
        self.crops.is_due(stamp.time_s())
    }

    /// Cuts out the vehicles whose keypoints were measured in this frame. Stationary vehicles whose pose comes from an
    /// earlier frame are left out.
    pub(crate) fn cut(&mut self, stamp: FrameStamp, image: &RgbImage, record: &FrameRecord) {
        let measured = record.cars.iter().filter(|car| car.keypoints.is_some() && car.pose_from.is_none());
        let crop = |bbox_px: [f64; 4]| {
            let region = around(bbox_px, image)?;
            let factor = region[2].max(region[3]).div_ceil(CROP_PX);
            let jpeg = compressed(&shrunk(image, region, factor), CROP_QUALITY)?;
            Some(Crop { frame: stamp.index, time_ms: time_ms(stamp), bbox_px, jpeg })
        };
        let crops: Vec<Crop> = measured.filter_map(|car| crop(car.bbox_px)).collect();
        self.keep_crops(stamp.time_s(), crops);
    }

    fn keep_crops(&mut self, time_s: f64, crops: Vec<Crop>) {
        if !crops.is_empty() {
            self.crops.keep(time_s, crops.iter().map(|crop| crop.jpeg.len() as u64).sum(), crops);
        }
    }

    /// Returns the small frames in the order of time.
    pub(crate) fn frames(&self) -> Vec<Still> {
        self.frames.items().cloned().collect()
    }

    /// Returns the index of the frame of each cut-out.
    pub(crate) fn crop_frames(&self) -> impl Iterator<Item = u64> {
        self.crops.items().flatten().map(|crop| crop.frame)
    }

    /// Returns the cut-outs for the report, sorted by track and then by time. `rows` are all track rows, sorted by
    /// frame.
    pub(crate) fn views(&self, rows: &[TrackRow]) -> Vec<TrackStill> {
        let mut of_track: BTreeMap<u64, Vec<&Crop>> = BTreeMap::new();
        for crop in self.crops.items().flatten() {
            let from = rows.partition_point(|row| row.frame < crop.frame);
            let here = rows[from..].iter().take_while(|row| row.frame == crop.frame);
            let overlap = |row: &TrackRow| bbox_iou(&row.bbox_px, &crop.bbox_px);
            let own = here.filter(|row| row.observed).max_by(|a, b| overlap(a).total_cmp(&overlap(b)));
            if let Some(row) = own.filter(|row| overlap(row) >= MIN_OVERLAP) {
                of_track.entry(row.track).or_default().push(crop);
            }
        }
        // All tracks have the same limit on cut-outs, which is as high as the report's size allows. If there are very
        // many tracks, only the first tracks get a cut-out.
        let chosen =
            |most: usize| of_track.iter().flat_map(move |(track, crops)| spread(*track, crops, most));
        let bytes = |most: usize| chosen(most).map(|(_, crop)| crop.jpeg.len() as u64).sum::<u64>();
        let most = (1..=VIEWS).rev().find(|most| bytes(*most) <= self.views_bytes).unwrap_or(1);
        let mut left = self.views_bytes;
        let fitting = chosen(most).map_while(|(track, crop)| {
            left = left.checked_sub(crop.jpeg.len() as u64)?;
            Some(TrackStill { track, still: Still { time_ms: crop.time_ms, jpeg: crop.jpeg.clone() } })
        });
        fitting.collect()
    }

    /// Writes the kept pictures to a file for [`Self::read`], and returns their spacing in time.
    pub(crate) fn write(&self, path: &Path) -> Result<StillLevels, PipelineError> {
        let mut lines = JsonLines::create(path)?;
        for still in self.frames.items() {
            lines.write(&Line { time_ms: still.time_ms, of: None, jpeg: STANDARD.encode(&still.jpeg) })?;
        }
        for Crop { frame, time_ms, bbox_px, jpeg } in self.crops.items().flatten() {
            lines.write(&Line {
                time_ms: *time_ms,
                of: Some((*frame, *bbox_px)),
                jpeg: STANDARD.encode(jpeg),
            })?;
        }
        lines.finish()?;
        Ok(StillLevels { frames: self.frames.level(), crops: self.crops.level() })
    }

    /// Reads the files of all pieces of an input, in order. The result is the same as that of a run over the whole
    /// input.
    pub(crate) fn read<'a>(
        report_mib: f64,
        pieces: impl Iterator<Item = (&'a Path, StillLevels)> + Clone,
    ) -> Result<Self, PipelineError> {
        let mut all = Self::new(report_mib);
        for (_, levels) in pieces.clone() {
            all.frames.coarsen(levels.frames);
            all.crops.coarsen(levels.crops);
        }
        for (path, _) in pieces {
            let mut moment: Vec<Crop> = Vec::new();
            for line in read_jsonl::<Line>(path)? {
                let Line { time_ms, of, jpeg } = line?;
                let jpeg = STANDARD
                    .decode(jpeg)
                    .map_err(|error| roadplane_write::WriteError::malformed(path, error))?;
                let Some((frame, bbox_px)) = of else {
                    all.keep_frame(Still { time_ms, jpeg });
                    continue;
                };
                if moment.last().is_some_and(|last| last.frame != frame) {
                    all.keep_moment(std::mem::take(&mut moment));
                }
                moment.push(Crop { frame, time_ms, bbox_px, jpeg });
            }
            all.keep_moment(moment);
        }
        Ok(all)
    }

    fn keep_frame(&mut self, still: Still) {
        let time_s = still.time_ms as f64 * 1e-3;
        if self.frames.is_due(time_s) {
            self.frames.keep(time_s, still.jpeg.len() as u64, still);
        }
    }

    fn keep_moment(&mut self, crops: Vec<Crop>) {
        let time_s = crops.first().map_or(0.0, |crop| crop.time_ms as f64 * 1e-3);
        if self.crops.is_due(time_s) {
            self.keep_crops(time_s, crops);
        }
    }
}

/// One line of the file of a piece: a small frame or a cut-out.
#[derive(Serialize, Deserialize)]
struct Line {
    time_ms: i64,
    /// Index of the frame and box of a cut-out, px. `None` for a small frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    of: Option<(u64, [f64; 4])>,
    jpeg: String,
}

/// Returns the time of a frame, rounded to whole milliseconds as in the file. A reader of the file then computes the
/// same time slots.
fn time_ms(stamp: FrameStamp) -> i64 {
    (stamp.time_s() * 1e3).round() as i64
}

/// Returns at most `most` cut-outs of a track, spread over the time of the track, each with the track's number.
fn spread<'a>(
    track: u64,
    crops: &'a [&'a Crop],
    most: usize,
) -> impl Iterator<Item = (u64, &'a Crop)> + use<'a> {
    let count = crops.len().min(most);
    let at = move |i: usize| if count > 1 { i * (crops.len() - 1) / (count - 1) } else { crops.len() / 2 };
    (0..count).map(move |i| (track, crops[at(i)]))
}

/// Returns the region to cut out for a box: left, top, width and height, px. `None` if the region is too small.
fn around([x0, y0, x1, y1]: [f64; 4], image: &RgbImage) -> Option<[u32; 4]> {
    let (more_x, more_y) = ((AROUND - 1.0) / 2.0 * (x1 - x0), (AROUND - 1.0) / 2.0 * (y1 - y0));
    let inside = |v: f64, most: u32| v.clamp(0.0, f64::from(most)) as u32;
    let (left, right) = (inside(x0 - more_x, image.width()), inside(x1 + more_x, image.width()));
    let (top, bottom) = (inside(y0 - more_y, image.height()), inside(y1 + more_y, image.height()));
    (right > left + 3 && bottom > top + 3).then(|| [left, top, right - left, bottom - top])
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{CarRecord, ImageSize, Keypoint};

    /// Returns a picture of noise that differs for every index.
    fn picture(index: u64) -> RgbImage {
        RgbImage::from_fn(320, 180, |x, y| {
            let noise =
                (u64::from(x) * 7919 + u64::from(y) * 104_729 + index * 31).wrapping_mul(2_654_435_761);
            image::Rgb([(noise >> 8) as u8, (noise >> 16) as u8, (noise >> 24) as u8])
        })
    }

    fn record(stamp: FrameStamp) -> FrameRecord {
        let mut car = CarRecord::boxed([100.0, 60.0, 160.0, 100.0]);
        car.keypoints = Some(Box::new(std::array::from_fn(|_| {
            Some(Keypoint::isotropic(nalgebra::Vector2::new(120.0, 80.0), 0.9, 1.0))
        })));
        let size = ImageSize { width: 320, height: 180 };
        FrameRecord { cars: vec![car], ..FrameRecord::empty(stamp.index, stamp.time_s(), size) }
    }

    fn stream(stills: &mut Stills, frames: std::ops::Range<u64>) {
        for index in frames {
            // At 10.01 frames per second, slots and frames have no common period.
            let stamp = FrameStamp { index, pts_nanos: (index * 99_900_000) as i64 };
            let image = picture(index);
            if stills.offer(stamp, &image) {
                stills.cut(stamp, &image, &record(stamp));
            }
        }
    }

    fn kept(stills: &Stills) -> (Vec<Still>, Vec<Crop>) {
        (stills.frames(), stills.crops.items().flatten().cloned().collect())
    }

    #[test]
    fn pieces_together_keep_the_pictures_of_the_whole_within_its_bounds() {
        let folder = tempfile::tempdir().unwrap();
        for mib in [0.0, 0.2, 16.0] {
            let mut whole = Stills::new(mib);
            stream(&mut whole, 0..400);
            let cuts = [0..70, 70..301, 301..400];
            let mut pieces = Vec::new();
            for (i, frames) in cuts.into_iter().enumerate() {
                let mut piece = Stills::new(mib);
                stream(&mut piece, frames);
                let path = folder.path().join(format!("{mib}-{i}.jsonl"));
                pieces.push((path.clone(), piece.write(&path).unwrap()));
            }
            let joined =
                Stills::read(mib, pieces.iter().map(|(path, levels)| (path.as_path(), *levels))).unwrap();
            assert_eq!(kept(&joined), kept(&whole));
            let bytes: usize = whole.frames().iter().map(|still| still.jpeg.len()).sum();
            assert!(bytes as f64 <= FRAMES_SHARE * mib * 1048576.0 / INLINED);
            assert_eq!(whole.frames().is_empty(), mib < 0.1);
            if mib > 1.0 {
                assert_eq!(whole.frames().len(), 120, "three per second");
            }
        }
    }

    #[test]
    fn cut_outs_find_their_tracks_and_are_spread_over_their_time() {
        let mut stills = Stills::new(4.0);
        stream(&mut stills, 0..400);
        let row = |track: u64, index: u64, left: f64| TrackRow {
            bbox_px: [left, 60.0, left + 60.0, 100.0],
            ..roadplane_synth::stationary_row(track, index, index as f64 * 0.0999)
        };
        let rows: Vec<TrackRow> = (0..400).flat_map(|i| [row(1, i, 20.0), row(2, i, 104.0)]).collect();
        let views = stills.views(&rows);
        assert_eq!(views.len(), VIEWS);
        assert!(views.iter().all(|view| view.track == 2));
        assert!(views[0].still.time_ms < 1000 && views[VIEWS - 1].still.time_ms > 38_000);
    }
}
