//! The decoder's result for one frame.

use image::RgbImage;
use roadplane_base::FrameStamp;

/// The stamp of a frame, and its pixels if they were requested.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// Index and time of the frame.
    pub stamp: FrameStamp,
    /// The pixels, RGB. The conversion to RGB costs a third of decoding a frame, so it is left out where the pixels are
    /// not needed.
    pub image: Option<RgbImage>,
}
