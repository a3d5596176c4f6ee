//! One decoded picture.

use image::RgbImage;
use serde::{Deserialize, Serialize};

use crate::ImageSize;

/// Which frame, and when it is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameStamp {
    /// Position in the input, counted from 0 in presentation order; frames that could not be decoded leave gaps.
    pub index: u64,
    /// Presentation time in nanoseconds from the start of the input, from the stream itself.
    pub pts_nanos: i64,
}

impl FrameStamp {
    /// Presentation time in seconds.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.pts_nanos as f64 * 1e-9
    }
}

/// A picture with its place in time.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Which frame this is.
    pub stamp: FrameStamp,
    /// The pixels, RGB.
    pub image: RgbImage,
}

impl Frame {
    /// Size of the picture.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        ImageSize { width: self.image.width(), height: self.image.height() }
    }

    /// Memory that the pixels take, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.image.as_raw().len()
    }
}
