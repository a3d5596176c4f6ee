//! Decodes one image file.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::{ImageError, ImageFormat, ImageReader, Limits, RgbImage};

use crate::sniff::Content;
use crate::{DecodeError, DecodeOptions};

/// Decodes an image file of a known kind, within the limits of the options.
pub(crate) fn read(path: &Path, content: Content, options: &DecodeOptions) -> Result<RgbImage, DecodeError> {
    let path_buf = || path.to_path_buf();
    let format = if content == Content::Png { ImageFormat::Png } else { ImageFormat::Jpeg };
    let open = || {
        let file = File::open(path).map_err(|source| DecodeError::Unreadable { source, path: path_buf() })?;
        Ok(ImageReader::with_format(BufReader::new(file), format))
    };
    let damaged = |error: ImageError| match error {
        ImageError::Limits(limit) => DecodeError::OverLimit { what: limit.to_string(), path: path_buf() },
        other => DecodeError::Damaged { what: other.to_string(), path: path_buf() },
    };
    let (width, height) = open()?.into_dimensions().map_err(damaged)?;
    check_size(path, width, height, options)?;
    let mut limits = Limits::default();
    // The decoder needs 16 bytes per pixel: two buffers with four channels of 16 bits.
    limits.max_alloc = Some(options.max_pixels.saturating_mul(16));
    let mut reader = open()?;
    reader.limits(limits);
    Ok(reader.decode().map_err(damaged)?.into_rgb8())
}

/// Rejects pictures that are empty or larger than the limit.
pub(crate) fn check_size(
    path: &Path,
    width: u32,
    height: u32,
    options: &DecodeOptions,
) -> Result<(), DecodeError> {
    let path = path.to_path_buf();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return Err(DecodeError::Damaged { what: format!("the picture has {width}×{height} px"), path });
    }
    if pixels > options.max_pixels {
        let most = options.max_pixels;
        return Err(DecodeError::OverLimit {
            what: format!("{width}×{height} is more than {most} px (decode.max_pixels)"),
            path,
        });
    }
    Ok(())
}
