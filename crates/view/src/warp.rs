//! Warping of pictures by a homography.

use image::RgbImage;
use opencv::core::{BORDER_CONSTANT, Mat, MatTraitConst as _, MatTraitConstManual as _, Scalar, Size};
use opencv::imgproc;
use roadplane_base::{Homography, ImageSize};

use crate::ViewError;

/// Returns a picture of the given size that shows a warped picture, resampled by cubic interpolation.
///
/// `warped_from_picture` maps pixels of `picture` to pixels of the result. Parts outside `picture` are black.
///
/// # Errors
/// [`ViewError::Drawing`].
pub fn warped(
    picture: &RgbImage,
    warped_from_picture: &Homography,
    size: ImageSize,
) -> Result<RgbImage, ViewError> {
    let rows = Mat::from_slice(picture.as_raw())?;
    let source = rows.reshape(3, i32::try_from(picture.height()).unwrap_or(0))?;
    let m = warped_from_picture.matrix();
    let rows: [[f64; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]));
    let matrix = Mat::from_slice_2d(&rows)?;
    let wanted = Size::new(i32::try_from(size.width).unwrap_or(0), i32::try_from(size.height).unwrap_or(0));
    let mut result = Mat::default();
    imgproc::warp_perspective(
        &source,
        &mut result,
        &matrix,
        wanted,
        imgproc::INTER_CUBIC,
        BORDER_CONSTANT,
        Scalar::default(),
    )?;
    let mut image = RgbImage::new(size.width, size.height);
    image.copy_from_slice(result.data_bytes()?);
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;
    use nalgebra::Matrix3;

    #[test]
    fn a_shift_moves_the_pixels() {
        let picture = RgbImage::from_fn(32, 16, |x, y| Rgb([(x * 8) as u8, (y * 16) as u8, 7]));
        let shift = Homography::new(Matrix3::new(1.0, 0.0, -5.0, 0.0, 1.0, -2.0, 0.0, 0.0, 1.0)).unwrap();
        let size = ImageSize { width: 20, height: 10 };
        let result = warped(&picture, &shift, size).unwrap();
        assert_eq!(result.dimensions(), (20, 10));
        assert!(result.enumerate_pixels().all(|(x, y, pixel)| pixel == picture.get_pixel(x + 5, y + 2)));
        let beyond = warped(&picture, &shift, ImageSize { width: 40, height: 10 }).unwrap();
        assert_eq!(beyond.get_pixel(39, 5), &Rgb([0, 0, 0]));
    }
}
