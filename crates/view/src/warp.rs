//! Warping of pictures.

use image::RgbImage;
use nalgebra::Vector2;
use opencv::core::{
    BORDER_CONSTANT, CV_32FC2, Mat, MatTrait as _, MatTraitConst as _, MatTraitConstManual as _, Point2f,
    Scalar,
};
use opencv::imgproc;
use roadplane_base::ImageSize;

use crate::ViewError;

/// Returns a picture of the given size that shows a warped picture, resampled by cubic interpolation.
///
/// `picture_from_warped` maps pixels of the result to pixels of `picture`. Parts outside `picture` are black.
///
/// # Errors
/// [`ViewError::Drawing`].
pub fn warped(
    picture: &RgbImage,
    size: ImageSize,
    picture_from_warped: impl Fn(&Vector2<f64>) -> Vector2<f64>,
) -> Result<RgbImage, ViewError> {
    let side = |length: u32| i32::try_from(length).unwrap_or(0);
    let rows = Mat::from_slice(picture.as_raw())?;
    let source = rows.reshape(3, side(picture.height()))?;
    let mut map =
        Mat::new_rows_cols_with_default(side(size.height), side(size.width), CV_32FC2, Scalar::default())?;
    for y in 0..size.height {
        for x in 0..size.width {
            let from = picture_from_warped(&Vector2::new(f64::from(x), f64::from(y)));
            *map.at_2d_mut::<Point2f>(side(y), side(x))? = Point2f::new(from.x as f32, from.y as f32);
        }
    }
    let mut result = Mat::default();
    imgproc::remap(
        &source,
        &mut result,
        &map,
        &Mat::default(),
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

    #[test]
    fn a_shift_moves_the_pixels() {
        let picture = RgbImage::from_fn(32, 16, |x, y| Rgb([(x * 8) as u8, (y * 16) as u8, 7]));
        let shift = |pixel: &Vector2<f64>| pixel + Vector2::new(5.0, 2.0);
        let result = warped(&picture, ImageSize { width: 20, height: 10 }, shift).unwrap();
        assert_eq!(result.dimensions(), (20, 10));
        assert!(result.enumerate_pixels().all(|(x, y, pixel)| pixel == picture.get_pixel(x + 5, y + 2)));
        let beyond = warped(&picture, ImageSize { width: 40, height: 10 }, shift).unwrap();
        assert_eq!(beyond.get_pixel(39, 5), &Rgb([0, 0, 0]));
    }
}
