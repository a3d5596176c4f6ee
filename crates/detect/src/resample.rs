//! Resamples a part of a frame for the net. The result has one plane of f32 values from 0 to 1 for each colour.

use image::RgbImage;
use ndarray::Array4;
use opencv::core::{Mat, MatTraitConst as _, MatTraitConstManual as _, Rect, Size, Vec3b};
use opencv::imgproc::{INTER_AREA, INTER_LINEAR, resize};

/// Both sides of the net's input must be multiples of this number, px.
pub(crate) const MULTIPLE_PX: usize = 32;
/// Value of the net's input in the padding beyond the picture. It is the middle grey with which the net was trained.
const PADDING: f32 = 114.0 / 255.0;

/// A rectangle of whole pixels of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Part {
    pub x: usize,
    pub y: usize,
    pub width: usize,
    pub height: usize,
}

impl Part {
    /// Returns the part that covers a whole picture.
    pub(crate) fn whole(image: &RgbImage) -> Self {
        Self { x: 0, y: 0, width: image.width() as usize, height: image.height() as usize }
    }
}

/// Resamples a part of a picture to `width` × `height` px. Smaller pictures are means over areas, and larger ones are
/// interpolated. The corners of the part and of the resampled picture coincide.
///
/// Returns the net's input with the shape [1, 3, rows, columns], padded at the right and the bottom.
pub(crate) fn input(
    image: &RgbImage,
    part: Part,
    width: usize,
    height: usize,
) -> opencv::Result<Array4<f32>> {
    let side = |length: usize| i32::try_from(length).unwrap_or(i32::MAX);
    let (rows, columns) = (side(image.height() as usize), side(image.width() as usize));
    let picture = Mat::new_rows_cols_with_bytes::<Vec3b>(rows, columns, image.as_raw())?;
    let cut = Mat::roi(&picture, Rect::new(side(part.x), side(part.y), side(part.width), side(part.height)))?;
    let mut scaled = Mat::default();
    if (part.width, part.height) == (width, height) {
        cut.copy_to(&mut scaled)?;
    } else {
        let is_larger = width > part.width || height > part.height;
        let method = if is_larger { INTER_LINEAR } else { INTER_AREA };
        resize(&cut, &mut scaled, Size::new(side(width), side(height)), 0.0, 0.0, method)?;
    }
    let bytes = scaled.data_bytes()?;
    let (rows, columns) = (height.next_multiple_of(MULTIPLE_PX), width.next_multiple_of(MULTIPLE_PX));
    let mut planes = vec![PADDING; 3 * rows * columns];
    let (red, rest) = planes.split_at_mut(rows * columns);
    let (green, blue) = rest.split_at_mut(rows * columns);
    for (y, line) in bytes.chunks_exact(3 * width).enumerate() {
        let row = y * columns..y * columns + width;
        let targets = red[row.clone()].iter_mut().zip(&mut green[row.clone()]).zip(&mut blue[row]);
        for (pixel, ((r, g), b)) in line.chunks_exact(3).zip(targets) {
            *r = f32::from(pixel[0]) * (1.0 / 255.0);
            *g = f32::from(pixel[1]) * (1.0 / 255.0);
            *b = f32::from(pixel[2]) * (1.0 / 255.0);
        }
    }
    let shaped = Array4::from_shape_vec((1, 3, rows, columns), planes);
    shaped.map_err(|error| opencv::Error::new(opencv::core::StsBadSize, error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws grey ramps along x and y. The grey level of a pixel shows its position, so a test can check that resampling
    /// does not shift the picture.
    fn ramp(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| image::Rgb([(2 * x) as u8, (3 * y) as u8, 100]))
    }

    #[test]
    fn centres_stay_where_they_are() {
        let image = ramp(120, 80);
        let part = Part { x: 10, y: 8, width: 100, height: 60 };
        for (width, height) in [(100, 60), (50, 30), (75, 45), (67, 40), (33, 19), (200, 120)] {
            let planes = input(&image, part, width, height).unwrap();
            for (x, y) in [(width / 2, height / 2), (width / 3, height / 4)] {
                let centre = |u: usize, source: f64, target: usize, from: f64| {
                    from + (u as f64 + 0.5) * source / target as f64 - 0.5
                };
                let value = |channel: usize| f64::from(planes[[0, channel, y, x]]) * 255.0;
                assert!(
                    (value(0) - 2.0 * centre(x, 100.0, width, 10.0)).abs() < 0.8,
                    "{width}: {}",
                    value(0)
                );
                assert!(
                    (value(1) - 3.0 * centre(y, 60.0, height, 8.0)).abs() < 0.8,
                    "{height}: {}",
                    value(1)
                );
                assert!((value(2) - 100.0).abs() < 1e-3);
            }
            assert_eq!(planes.dim(), (1, 3, height.next_multiple_of(32), width.next_multiple_of(32)));
            let corner = planes[[0, 1, planes.dim().2 - 1, planes.dim().3 - 1]];
            assert!((corner - PADDING).abs() < 1e-6, "padded");
        }
    }
}
