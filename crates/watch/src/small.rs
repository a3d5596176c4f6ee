//! The reduced grey copy of a frame, on which most steps of this crate work.

use image::RgbImage;
use opencv::core::{CV_8UC3, Mat, MatTraitConst as _, MatTraitConstManual as _, Size, Vec3b};
use opencv::imgproc::{COLOR_RGB2GRAY, INTER_AREA, cvt_color_def, resize};

use crate::WatchError;

/// Largest length of the longer side of the reduced picture, px.
const LONGEST: u32 = 480;

/// A reduced grey copy of a frame: the frame is halved until its longer side is at most 480 px.
///
/// Every pixel is the mean of `factor` × `factor` pixels of the frame. Frame pixels at the right and the bottom that do
/// not fill a whole pixel are left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SmallGrey {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Number of frame pixels along each side of one pixel of this picture.
    pub factor: usize,
    /// Grey values, row by row.
    pub values: Vec<u8>,
}

impl SmallGrey {
    /// Creates the reduced grey copy of a frame.
    ///
    /// # Errors
    /// [`WatchError`] when OpenCV fails.
    pub fn of(image: &RgbImage) -> Result<Self, WatchError> {
        let side = |length: u32| i32::try_from(length).unwrap_or(i32::MAX);
        let pixels = Mat::new_rows_cols_with_bytes::<Vec3b>(
            side(image.height()),
            side(image.width()),
            image.as_raw(),
        )?;
        debug_assert_eq!(pixels.typ(), CV_8UC3);
        let mut grey = Mat::default();
        cvt_color_def(&pixels, &mut grey, COLOR_RGB2GRAY)?;
        let mut factor = 1;
        let mut longest = image.width().max(image.height());
        // OpenCV has fast code for exact halves.
        while longest > LONGEST && grey.cols() >= 2 && grey.rows() >= 2 {
            let size = Size::new(grey.cols() / 2, grey.rows() / 2);
            let whole = Mat::roi(&grey, opencv::core::Rect::new(0, 0, size.width * 2, size.height * 2))?;
            let mut half = Mat::default();
            resize(&whole, &mut half, size, 0.0, 0.0, INTER_AREA)?;
            grey = half;
            factor *= 2;
            longest /= 2;
        }
        let count = |length: i32| usize::try_from(length).unwrap_or(0);
        let (width, height) = (count(grey.cols()), count(grey.rows()));
        Ok(Self { width, height, factor, values: grey.data_bytes()?.to_vec() })
    }

    /// Returns the grey values of row `y`.
    #[must_use]
    pub fn row(&self, y: usize) -> &[u8] {
        &self.values[y * self.width..(y + 1) * self.width]
    }

    /// Returns the picture at half the size.
    pub(crate) fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut values = Vec::with_capacity(width * height);
        for y in 0..height {
            let (upper, lower) = (self.row(2 * y), self.row(2 * y + 1));
            values.extend(upper.chunks_exact(2).zip(lower.chunks_exact(2)).map(|(a, b)| {
                ((u16::from(a[0]) + u16::from(a[1]) + u16::from(b[0]) + u16::from(b[1]) + 2) / 4) as u8
            }));
        }
        Self { width, height, factor: 2 * self.factor, values }
    }

    /// Whether two pictures are of the same size.
    #[must_use]
    pub fn same_size(&self, other: &Self) -> bool {
        (self.width, self.height) == (other.width, other.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_the_mean_of_its_square() {
        let image = RgbImage::from_fn(1003, 600, |x, y| {
            let v = ((x / 4) % 50 + (y / 4) % 40) as u8 * 2;
            image::Rgb([v, v, v])
        });
        let small = SmallGrey::of(&image).unwrap();
        assert_eq!((small.width, small.height, small.factor), (250, 150, 4));
        for (x, y) in [(0, 0), (17, 33), (249, 149)] {
            assert_eq!(usize::from(small.row(y)[x]), (x % 50 + y % 40) * 2);
        }
    }

    #[test]
    fn small_frames_stay_as_they_are() {
        assert_eq!(SmallGrey::of(&RgbImage::new(320, 240)).unwrap().factor, 1);
        assert_eq!(SmallGrey::of(&RgbImage::new(1, 1)).unwrap().values, [0]);
    }
}
