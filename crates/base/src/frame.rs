//! One decoded frame of the input.

use image::RgbImage;
use serde::{Deserialize, Serialize};

use crate::ImageSize;

/// Index and presentation time of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameStamp {
    /// Index of the frame in the input, from 0 in presentation order. The indices of frames that could not be decoded
    /// are skipped.
    pub index: u64,
    /// Presentation time of the frame, ns from the start of the input.
    pub pts_nanos: i64,
}

impl FrameStamp {
    /// Returns the presentation time in seconds.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.pts_nanos as f64 * 1e-9
    }
}

/// A picture with its index and presentation time.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Index and presentation time.
    pub stamp: FrameStamp,
    /// The pixels, RGB.
    pub image: RgbImage,
}

impl Frame {
    /// Returns the width and height of the picture.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        ImageSize { width: self.image.width(), height: self.image.height() }
    }

    /// Returns the size of the pixels in memory, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.image.as_raw().len()
    }
}
