//! Reads one video file through OpenCV and counts its delivered and lost frames.

use std::path::{Path, PathBuf};

use image::RgbImage;
use opencv::core::{CV_8UC3, Mat, Vec3b};
use opencv::imgproc::{COLOR_BGR2RGB, cvt_color_def};
use opencv::prelude::*;
use opencv::videoio::{
    CAP_FFMPEG, CAP_PROP_FPS, CAP_PROP_FRAME_COUNT, CAP_PROP_FRAME_HEIGHT, CAP_PROP_FRAME_WIDTH,
    CAP_PROP_POS_MSEC, VideoCapture,
};
use roadplane_base::FrameStamp;

use crate::clock::Clock;
use crate::options::Verdict;
use crate::packets::Packets;
use crate::still::check_size;
use crate::structure::{is_cut_short, is_trimmed};
use crate::{Content, DecodeError, DecodeOptions, DecodeReport, Decoded};

/// Number of consecutive failed reads after which the stream counts as ended. Each failed read skips a packet that
/// cannot be decoded.
const MAX_FAILED_READS: u32 = 5000;
/// Frame rate if the stream states no usable one, 1/s.
const FALLBACK_FPS: f64 = 30.0;
/// Largest frame count that is accepted from a container: about a year at 30 frames/s.
const MAX_PROMISED: f64 = 1e9;

/// Largest deviation of a frame's time from a steady rate, as a share of the time between frames. With a larger
/// deviation, the time does not identify the frame.
const STEADY_RATE: f64 = 0.05;
/// Decoding starts at a key frame about this long before the requested part, s.
const LEAD_S: f64 = 0.5;

/// Longest gap between frames that counts as damage, s. A longer gap may be a pause. This limit applies to containers
/// without an exact frame count.
const MAX_GAP_S: f64 = 10.0;

/// An open video file.
pub(crate) struct Video {
    path: PathBuf,
    content: Content,
    capture: VideoCapture,
    clock: Clock,
    /// Index of the next frame. Lost frames have indices, too.
    next_index: u64,
    /// The last gap in the times: the index of its first frame, its number of frames, and the time before it (s). The
    /// next frame decides whether the gap is a loss.
    gap: Option<(u64, u64, f64)>,
    fps: f64,
    promised: Option<u64>,
    size: Option<(u32, u32)>,
    bgr: Mat,
    /// Pictures whose memory can be reused.
    spare: Vec<RgbImage>,
    /// Time from which frames and losses are counted, s; `None` once counting has started.
    counted_from_s: Option<f64>,
    /// Number of frames before the first one that is counted in the report.
    uncounted: u64,
    /// Whether reading started inside the file.
    pub(crate) begun_within: bool,
}

impl Video {
    pub(crate) fn open(path: &Path, content: Content, options: &DecodeOptions) -> Result<Self, DecodeError> {
        let not_media =
            |what: &str| DecodeError::NotMedia { what: what.to_owned(), path: path.to_path_buf() };
        // FFmpeg cannot mistake an absolute path for a protocol or an option.
        let absolute = path
            .canonicalize()
            .map_err(|source| DecodeError::Unreadable { source, path: path.to_path_buf() })?;
        let name = absolute.to_str().ok_or_else(|| not_media("its path is not UTF-8: rename it"))?;
        let capture = captured(name)?;
        if !capture.is_opened().map_err(library)? {
            let what = if is_cut_short(path, content) {
                "the file ends before the data that decoding needs"
            } else {
                "no video stream that can be decoded"
            };
            return Err(DecodeError::Damaged { what: what.to_owned(), path: path.to_path_buf() });
        }
        let number = |property| capture.get(property).unwrap_or(0.0);
        let pixels = |property| number(property).clamp(0.0, f64::from(u32::MAX)) as u32;
        check_size(path, pixels(CAP_PROP_FRAME_WIDTH), pixels(CAP_PROP_FRAME_HEIGHT), options)?;
        let fps = number(CAP_PROP_FPS);
        let promised = number(CAP_PROP_FRAME_COUNT);
        let fps = if fps > 0.0 && fps <= options.max_fps { fps } else { FALLBACK_FPS.min(options.max_fps) };
        Ok(Self {
            path: absolute,
            content,
            clock: Clock::new(fps),
            next_index: 0,
            gap: None,
            fps,
            promised: (1.0..=MAX_PROMISED).contains(&promised).then_some(promised as u64),
            size: None,
            bgr: Mat::default(),
            spare: Vec::new(),
            counted_from_s: None,
            uncounted: 0,
            begun_within: false,
            capture,
        })
    }

    /// Jumps to about `start_s` if the stream's times identify the frames. The report counts from the time
    /// `counted_from_s` on.
    pub(crate) fn begin_part(&mut self, start_s: f64, counted_from_s: f64) -> Result<(), DecodeError> {
        self.counted_from_s = Some(counted_from_s);
        let to_s = start_s - LEAD_S;
        if to_s <= LEAD_S {
            return Ok(());
        }
        match self.jump(to_s, start_s) {
            Some((index, millis)) => {
                self.begun_within = true;
                self.next_index = index + 1;
                self.clock.begin_steady(millis);
            }
            None => {
                tracing::info!(
                    "the frames have no steady rate, so decoding starts at the beginning and not at {start_s} s"
                );
                self.capture = captured(self.path.to_str().unwrap_or_default())?;
            }
        }
        Ok(())
    }

    /// Jumps to a frame between two times, s. Returns the frame's index and time (ms) if both are certain, and
    /// otherwise `None`.
    fn jump(&mut self, from_s: f64, before_s: f64) -> Option<(u64, f64)> {
        let step = 1e3 / self.fps;
        let millis = |capture: &mut VideoCapture| {
            let grabbed = capture.grab().ok()?;
            capture.get(CAP_PROP_POS_MSEC).ok().filter(|_| grabbed)
        };
        let first = millis(&mut self.capture)?;
        // The second frame shows whether the stream really has the frame rate that the container states.
        let second = millis(&mut self.capture)?;
        let is_steady = |steps: f64| (steps - steps.round()).abs() <= STEADY_RATE;
        self.capture.set(CAP_PROP_POS_MSEC, 1e3 * from_s).ok()?;
        let here = millis(&mut self.capture)?;
        let steps = (here - first) / step;
        // The mean rate of a video with missing pictures is no rate of a camera. Its steps would drift.
        let is_rate = |rate: f64| (2.0 * rate - (2.0 * rate).round()).abs() < 1e-6 * rate;
        let is_nominal = is_rate(self.fps) || is_rate(1.001 * self.fps);
        let known = is_nominal && is_steady((second - first) / step) && is_steady(steps) && steps >= 1.0;
        (known && here < 1e3 * before_s).then_some((steps.round() as u64, here))
    }

    /// Returns the number of frames that the container states. It is an estimate that serves only to show progress.
    pub(crate) fn promised(&self) -> Option<u64> {
        self.promised
    }

    /// Takes back a picture. A later picture reuses its memory.
    pub(crate) fn reuse(&mut self, image: RgbImage) {
        self.spare.push(image);
    }

    /// Returns the nominal frame rate, 1/s.
    pub(crate) fn fps(&self) -> f64 {
        self.fps
    }

    /// Returns the next frame that the options choose, with its pixels if `wanted` returns true. Returns `None` at the
    /// end, when the report is complete.
    pub(crate) fn next(
        &mut self,
        options: &DecodeOptions,
        report: &mut DecodeReport,
        wanted: &mut dyn FnMut(&FrameStamp) -> bool,
    ) -> Result<Option<Decoded>, DecodeError> {
        let mut failed = 0;
        loop {
            if !self.capture.grab().unwrap_or(false) {
                failed += 1;
                if failed == MAX_FAILED_READS {
                    self.account_for_the_end(report);
                    return Ok(None);
                }
                continue;
            }
            failed = 0;
            let stamp = self.stamp(report);
            if self.counted_from_s.is_some_and(|from_s| stamp.time_s() >= from_s) {
                self.counted_from_s = None;
                self.uncounted = stamp.index - self.gap.map_or(0, |(_, frames, _)| frames);
                report.restart();
            }
            match options.verdict(stamp.index, stamp.pts_nanos, report.delivered) {
                Verdict::Over => return Ok(None),
                Verdict::Skip => report.decoded_one(),
                Verdict::Take if !wanted(&stamp) => {
                    report.decoded_one();
                    return Ok(Some(Decoded { stamp, image: None }));
                }
                Verdict::Take => match self.picture(options) {
                    Ok(image) => {
                        report.decoded_one();
                        return Ok(Some(Decoded { stamp, image: Some(image) }));
                    }
                    Err(what) => {
                        report.left_out(stamp.index, stamp.time_s(), &what);
                    }
                },
            }
        }
    }

    /// Returns the stamp of the picture that was just grabbed. Counts the frames that were lost before it.
    fn stamp(&mut self, report: &mut DecodeReport) -> FrameStamp {
        let before_s = self.clock.last_s();
        let tick = self.clock.tick(self.capture.get(CAP_PROP_POS_MSEC).unwrap_or(f64::NAN));
        report.times_made_up += tick.made_up;
        let gap = self.gap.take();
        if tick.usual {
            Self::settle(gap, report);
        }
        if tick.skipped > 0 {
            let gap_s = self.clock.last_s() - before_s;
            if !self.counts_frames() && gap_s > MAX_GAP_S {
                report.warn(format!(
                    "{gap_s:.1} s without a frame from {before_s:.1} s on: a pause, or damage"
                ));
            } else {
                self.gap = Some((self.next_index, tick.skipped, before_s));
            }
            self.next_index += tick.skipped;
        }
        let index = self.next_index;
        self.next_index += 1;
        FrameStamp { index, pts_nanos: tick.pts_nanos }
    }

    fn settle(gap: Option<(u64, u64, f64)>, report: &mut DecodeReport) {
        if let Some((index, frames, from_s)) = gap {
            report.lost(index, frames, from_s);
        }
    }

    /// Whether the container's frame count is exact.
    fn counts_frames(&self) -> bool {
        matches!(self.content, Content::Avi | Content::Mp4)
    }

    /// Returns the pixels of the picture that was just grabbed.
    fn picture(&mut self, options: &DecodeOptions) -> Result<RgbImage, String> {
        let text = |error: opencv::Error| error.to_string();
        if !self.capture.retrieve_def(&mut self.bgr).map_err(text)? || self.bgr.empty() {
            return Err("the decoder gives no pixels".to_owned());
        }
        let side = |length: i32| u32::try_from(length).unwrap_or(0);
        let (width, height) = (side(self.bgr.cols()), side(self.bgr.rows()));
        check_size(&self.path, width, height, options).map_err(|error| error.to_string())?;
        if *self.size.get_or_insert((width, height)) != (width, height) {
            return Err(format!("its size differs from that of the first frame: {width}×{height}"));
        }
        if self.bgr.typ() != CV_8UC3 {
            return Err("its pixels are not 8-bit colour".to_owned());
        }
        // The conversion writes directly into the memory of the returned picture.
        let spare = self.spare.pop().filter(|image| image.dimensions() == (width, height));
        let mut image = spare.unwrap_or_else(|| RgbImage::new(width, height));
        let pixels: &mut [u8] = &mut image;
        let mut rgb = Mat::new_rows_cols_with_bytes_mut::<Vec3b>(self.bgr.rows(), self.bgr.cols(), pixels)
            .map_err(text)?;
        cvt_color_def(&self.bgr, &mut rgb, COLOR_BGR2RGB).map_err(text)?;
        drop(rgb);
        Ok(image)
    }

    /// Counts the losses that can be detected only at the end of the stream.
    fn account_for_the_end(&mut self, report: &mut DecodeReport) {
        Self::settle(self.gap.take(), report);
        report.cut_short = is_cut_short(&self.path, self.content);
        let packets = self.path.to_str().and_then(Packets::read).unwrap_or_default();
        report.broken_packets = packets.broken;
        let seen = self.uncounted + report.expected;
        let decoded = self.uncounted + report.decoded;
        // Frames that an edit list leaves out are neither shown nor lost. OpenCV does not report which frames these
        // are.
        let trimmed = self.content == Content::Mp4 && is_trimmed(&self.path);
        let contained = match self.promised {
            Some(promised) if self.counts_frames() || report.cut_short => promised.max(packets.count),
            _ => packets.count,
        };
        if self.counts_frames() && !trimmed && contained < seen && contained >= decoded {
            // A variable frame rate, not damage, caused the gaps.
            report.remove_gaps(contained - decoded);
        }
        let absent = contained.saturating_sub(self.uncounted + report.expected);
        if absent > 0 && !trimmed {
            report.lost(self.next_index, absent, self.clock.last_s());
        }
    }
}

fn captured(name: &str) -> Result<VideoCapture, DecodeError> {
    VideoCapture::from_file(name, CAP_FFMPEG).map_err(library)
}

fn library(error: opencv::Error) -> DecodeError {
    DecodeError::Library { what: error.to_string() }
}
