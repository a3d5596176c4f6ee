//! The decoder's result for one frame.

use image::RgbImage;
use roadplane_base::FrameStamp;

/// A frame's stamp, and its pixels if they were requested.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// Index and time of the frame.
    pub stamp: FrameStamp,
    /// The pixels in RGB, or `None` if they were not requested. The conversion to RGB takes a third of a frame's
    /// decoding time, so it is left out if nobody needs the pixels.
    pub image: Option<RgbImage>,
}
