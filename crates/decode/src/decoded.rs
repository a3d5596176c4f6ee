//! A frame as it comes out.

use image::RgbImage;
use roadplane_base::FrameStamp;

/// A frame's place, and its pixels where they were asked for.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// Which frame.
    pub stamp: FrameStamp,
    /// The pixels, RGB; turning them into RGB costs a third of decoding a frame, so it is left out where nobody looks.
    pub image: Option<RgbImage>,
}
