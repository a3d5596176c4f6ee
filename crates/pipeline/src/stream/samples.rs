//! Collects a few frames for the report, spread evenly over a clip of unknown length.

use image::RgbImage;
use image::codecs::jpeg::JpegDecoder;
use roadplane_base::FrameStamp;

use crate::stream::small_picture::compressed;

/// JPEG quality of kept frames. The loss at this quality is not visible.
const QUALITY: u8 = 92;

/// Keeps one of every `stride` pictures, as a JPEG file. When twice as many pictures as wanted are kept, every other
/// picture is dropped and `stride` doubles.
#[derive(Debug)]
pub struct SampleFrames {
    wanted: usize,
    stride: u64,
    seen: u64,
    kept: Vec<(FrameStamp, Vec<u8>)>,
}

impl SampleFrames {
    /// Creates an empty collection that keeps between `wanted` and 2 × `wanted` pictures. `expected` is the number of
    /// pictures that will be offered, if it is known. This number lets the collection skip pictures that it would drop
    /// later.
    #[must_use]
    pub fn new(wanted: usize, expected: Option<u64>) -> Self {
        let stride = expected.map_or(1, |count| count / (2 * wanted.max(1) as u64)).max(1);
        Self { wanted, stride, seen: 0, kept: Vec::new() }
    }

    /// Receives the next picture of the clip, and keeps every picture whose number is a multiple of `stride`.
    pub fn offer(&mut self, stamp: FrameStamp, image: &RgbImage) {
        let due = self.wanted > 0 && self.seen.is_multiple_of(self.stride);
        self.seen += 1;
        if !due {
            return;
        }
        let Some(jpeg) = compressed(image, QUALITY) else { return };
        self.kept.push((stamp, jpeg));
        if self.kept.len() >= 2 * self.wanted {
            let mut count = 0;
            self.kept.retain(|_| {
                count += 1;
                count % 2 == 1
            });
            self.stride *= 2;
        }
    }

    /// Returns at most `wanted` frames, spread over the clip: index, time in s, picture.
    #[must_use]
    pub fn finish(self) -> Vec<(u64, f64, RgbImage)> {
        let count = self.kept.len();
        let chosen = self.wanted.min(count);
        (0..chosen)
            .filter_map(|i| {
                let at = if chosen > 1 { i * (count - 1) / (chosen - 1) } else { 0 };
                let (stamp, jpeg) = &self.kept[at];
                let decoder = JpegDecoder::new(std::io::Cursor::new(jpeg)).ok()?;
                Some((
                    stamp.index,
                    stamp.time_s(),
                    image::DynamicImage::from_decoder(decoder).ok()?.into_rgb8(),
                ))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_few_and_spread_over_clips_of_any_length() {
        for length in [1u64, 2, 5, 37, 1000] {
            let mut samples = SampleFrames::new(4, (length % 2 == 0).then_some(length));
            for index in 0..length {
                let stamp = FrameStamp { index, pts_nanos: 0 };
                samples.offer(stamp, &RgbImage::new(8, 8));
                assert!(samples.kept.len() <= 8);
            }
            let indices: Vec<u64> = samples.finish().iter().map(|s| s.0).collect();
            assert_eq!(indices.len() as u64, length.min(4));
            assert_eq!(indices[0], 0);
            assert!(indices[indices.len() - 1] >= length / 2, "{indices:?} of {length}");
        }
    }
}
