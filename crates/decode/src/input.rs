//! Opens a path as a stream of frames.

use std::path::{Path, PathBuf};

use image::RgbImage;
use roadplane_base::{Frame, FrameStamp, ImageSize};

use crate::address::refuse_address;
use crate::decoded::Decoded;
use crate::folder::Images;
use crate::sniff::sniff;
use crate::video::Video;
use crate::{Content, DecodeError, DecodeOptions, DecodeReport};

/// The kind of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputKind {
    /// A video file.
    Video(Content),
    /// A single image.
    Image,
    /// A folder of images.
    Folder,
}

enum Source {
    Video(Box<Video>),
    Images(Images),
}

/// An open input. It delivers frames in presentation order and a report of the lost frames.
pub struct Input {
    source: Source,
    kind: InputKind,
    options: DecodeOptions,
    report: DecodeReport,
    /// The first frame, which is decoded when the input is opened.
    first: Option<Decoded>,
    size: ImageSize,
    finished: bool,
}

/// Opens a video file, an image or a folder of images and decodes its first frame.
///
/// # Errors
/// [`DecodeError`] if the input is neither a video nor an image, cannot be read, exceeds a limit, or gives no frame at
/// all. It is also returned for an invalid option.
pub fn open(path: &Path, options: &DecodeOptions) -> Result<Input, DecodeError> {
    open_source(path, options, None)
}

/// Opens a part of a long clip, from the start to the end given in `options`.
///
/// If the times of a video identify its frames, decoding starts shortly before the part. Otherwise it starts at the
/// beginning. The report counts frames and losses from the time `counted_from_s` (s) on.
///
/// # Errors
/// [`DecodeError`] in the same cases as for [`open`].
pub fn open_part(path: &Path, options: &DecodeOptions, counted_from_s: f64) -> Result<Input, DecodeError> {
    open_source(path, options, Some(counted_from_s))
}

fn open_source(
    path: &Path,
    options: &DecodeOptions,
    counted_from_s: Option<f64>,
) -> Result<Input, DecodeError> {
    options.check()?;
    refuse_address(path)?;
    let mut report = DecodeReport::default();
    let metadata =
        path.metadata().map_err(|source| DecodeError::Unreadable { source, path: path.to_path_buf() })?;
    let (mut source, kind) = if metadata.is_dir() {
        (Source::Images(Images::in_folder(path, options, &mut report)?), InputKind::Folder)
    } else {
        let content = sniff(path)?;
        if content.is_image() {
            (Source::Images(Images::single(path)), InputKind::Image)
        } else {
            let mut video = Video::open(path, content, options)?;
            if let Some(counted_from_s) = counted_from_s {
                video.begin_part(options.start_s, counted_from_s)?;
            }
            (Source::Video(Box::new(video)), InputKind::Video(content))
        }
    };
    let Some(first) = source.next(options, &mut report, &mut |_| true)? else {
        return Err(nothing_decoded(path.to_path_buf(), options, &report));
    };
    let (width, height) = first.image.as_ref().map_or((0, 0), RgbImage::dimensions);
    let size = ImageSize { width, height };
    Ok(Input { source, kind, options: options.clone(), report, first: Some(first), size, finished: false })
}

fn nothing_decoded(path: PathBuf, options: &DecodeOptions, report: &DecodeReport) -> DecodeError {
    if report.decoded > 0 {
        let DecodeOptions { start_s, end_s, stride, .. } = options;
        let end = end_s.map_or_else(String::new, |end_s| format!(", end {end_s} s"));
        let what = format!(
            "the settings start {start_s} s{end} and stride {stride} leave out all frames of {}",
            path.display()
        );
        return DecodeError::Option { what };
    }
    let why = report.warnings.first().map(|warning| format!(" ({warning})")).unwrap_or_default();
    DecodeError::Damaged { what: format!("none of {} frames can be decoded{why}", report.expected), path }
}

impl Source {
    fn next(
        &mut self,
        options: &DecodeOptions,
        report: &mut DecodeReport,
        wanted: &mut dyn FnMut(&FrameStamp) -> bool,
    ) -> Result<Option<Decoded>, DecodeError> {
        match self {
            Self::Video(video) => video.next(options, report, wanted),
            Self::Images(images) => images.next(options, report),
        }
    }
}

impl Input {
    /// Returns the next frame with its pixels, or `None` at the end of the input. At the end, [`Input::report`] is
    /// complete.
    ///
    /// # Errors
    /// [`DecodeError`] only if no frame at all can be delivered. Single lost frames are listed in the report instead.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, DecodeError> {
        let decoded = self.next_where(|_| true)?;
        Ok(decoded.and_then(|d| Some(Frame { stamp: d.stamp, image: d.image? })))
    }

    /// Returns the next frame, with its pixels if `wanted` returns true. Returns `None` at the end of the input, when
    /// [`Input::report`] is complete.
    ///
    /// The input's first frame and image files always have pixels, because these are decoded anyway.
    ///
    /// # Errors
    /// [`DecodeError`] in the same cases as for [`Self::next_frame`].
    pub fn next_where(
        &mut self,
        mut wanted: impl FnMut(&FrameStamp) -> bool,
    ) -> Result<Option<Decoded>, DecodeError> {
        if self.finished {
            return Ok(None);
        }
        let frame = match self.first.take() {
            Some(first) => {
                wanted(&first.stamp);
                Some(first)
            }
            None => self.source.next(&self.options, &mut self.report, &mut wanted)?,
        };
        match &frame {
            Some(_) => self.report.delivered += 1,
            None => {
                self.finished = true;
                self.warn_of_losses();
            }
        }
        Ok(frame)
    }

    /// Takes back a picture that the caller no longer needs. A later picture reuses its memory, so a long video needs
    /// no new memory for each frame.
    pub fn reuse(&mut self, image: RgbImage) {
        if let Source::Video(video) = &mut self.source {
            video.reuse(image);
        }
    }

    fn warn_of_losses(&mut self) {
        let made_up = self.report.times_made_up;
        if made_up > 0 {
            self.report.warn(format!("{made_up} frames had no usable time, so their times were invented"));
        }
        // The sentence is not stored: a file that is read in pieces gets one sentence from the sum of its pieces.
        if let Some(damage) = self.report.damage_in_words() {
            tracing::warn!("{damage}");
        }
    }

    /// Returns the kind of the input.
    #[must_use]
    pub fn kind(&self) -> InputKind {
        self.kind
    }

    /// Returns the size of the pictures.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// Whether decoding started inside the video, so that earlier frames were skipped.
    #[must_use]
    pub fn is_begun_within(&self) -> bool {
        matches!(&self.source, Source::Video(video) if video.begun_within)
    }

    /// Returns the expected number of frames, according to the container or the number of images. A container's number
    /// may be wrong, so it serves only to show progress.
    #[must_use]
    pub fn frames_hint(&self) -> Option<u64> {
        match &self.source {
            Source::Video(video) => video.promised(),
            Source::Images(images) => Some(images.count()),
        }
    }

    /// Returns the expected number of delivered frames. The options choose them from [`Self::frames_hint`] frames.
    #[must_use]
    pub fn frames_due(&self) -> Option<u64> {
        Some(self.options.chosen_of(self.frames_hint()?, self.nominal_fps()))
    }

    /// Returns the nominal frame rate, 1/s, for writing videos at the same rate. The exact time of each frame is in its
    /// stamp.
    #[must_use]
    pub fn nominal_fps(&self) -> f64 {
        match &self.source {
            Source::Video(video) => video.fps(),
            Source::Images(_) => self.options.image_rate(),
        }
    }

    /// Returns the report on the frames that were read so far.
    #[must_use]
    pub fn report(&self) -> &DecodeReport {
        &self.report
    }
}
