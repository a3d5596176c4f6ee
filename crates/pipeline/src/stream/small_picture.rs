//! Makes small pictures for the report. A run makes them while it reads frames, so these functions must be fast.

use image::RgbImage;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

/// Returns a part of a picture, reduced by a whole `factor`. Each new pixel is the mean of a block of `factor` ×
/// `factor` pixels.
///
/// The part is given as left, top, width and height, px, and must lie inside the picture. Columns and rows that do not
/// fill a block are left out.
pub(crate) fn shrunk(image: &RgbImage, [left, top, width, height]: [u32; 4], factor: u32) -> RgbImage {
    let factor = factor.clamp(1, 255).min(width.max(1)).min(height.max(1));
    let (small_width, small_height) = (width / factor, height / factor);
    let (size, row_bytes) = (factor as usize, 3 * image.width() as usize);
    let used = 3 * small_width as usize * size;
    let from = 3 * left as usize;
    let mut small = Vec::with_capacity(3 * (small_width * small_height) as usize);
    let mut sums = vec![0_u16; used];
    let half = (factor * factor / 2) as usize;
    for row in 0..small_height {
        sums.fill(0);
        for line in 0..factor {
            let start = (top + row * factor + line) as usize * row_bytes + from;
            let pixels = image.as_raw().get(start..start + used).unwrap_or_default();
            sums.iter_mut().zip(pixels).for_each(|(sum, value)| *sum += u16::from(*value));
        }
        for block in sums.chunks_exact(3 * size) {
            for channel in 0..3 {
                let sum: usize = block[channel..].iter().step_by(3).map(|sum| usize::from(*sum)).sum();
                small.push(((sum + half) / (size * size)) as u8);
            }
        }
    }
    RgbImage::from_raw(small_width, small_height, small).unwrap_or_default()
}

/// Returns the bytes of a picture as a JPEG file. If the picture cannot be encoded, logs a warning and returns `None`.
pub(crate) fn compressed(image: &RgbImage, quality: u8) -> Option<Vec<u8>> {
    let mut jpeg = Vec::new();
    let mut encoder = Encoder::new(&mut jpeg, quality);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    let [width, height] = [image.width(), image.height()].map(|side| u16::try_from(side).unwrap_or(0));
    match encoder.encode(image.as_raw(), width, height, ColorType::Rgb) {
        Ok(()) => Some(jpeg),
        Err(error) => {
            tracing::warn!("the report lacks a picture that cannot be encoded: {error}");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_become_their_means_and_files_are_pictures() {
        let image = RgbImage::from_fn(10, 7, |x, y| image::Rgb([(10 * x) as u8, (20 * y) as u8, 200]));
        let small = shrunk(&image, [2, 1, 7, 5], 2);
        assert_eq!(small.dimensions(), (3, 2));
        assert_eq!(small.get_pixel(0, 0).0, [25, 30, 200]);
        assert_eq!(small.get_pixel(2, 1).0, [65, 70, 200]);
        assert_eq!(shrunk(&image, [0, 0, 10, 7], 1), image);
        let jpeg = compressed(&image, 90).unwrap();
        let back = image::load_from_memory_with_format(&jpeg, image::ImageFormat::Jpeg).unwrap().into_rgb8();
        assert_eq!(back.dimensions(), (10, 7));
        assert!(back.get_pixel(5, 3).0[2].abs_diff(200) < 12);
        assert!(compressed(&RgbImage::new(0, 0), 90).is_none());
    }
}
