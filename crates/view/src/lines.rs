//! Edges of a scene drawn into its picture.

use image::RgbImage;
use roadplane_base::SceneLine;

use crate::ViewError;
use crate::canvas::{Canvas, Rgb};

const UPRIGHT: Rgb = [40, 200, 60];
const OTHER: Rgb = [200, 60, 50];

/// The picture, pale, with edges in it: upright ones green, others red.
///
/// # Errors
/// [`ViewError`] when OpenCV fails.
pub fn with_lines<'a>(
    picture: &RgbImage,
    lines: impl Iterator<Item = (&'a SceneLine, bool)>,
) -> Result<RgbImage, ViewError> {
    let mut pale = picture.clone();
    for value in pale.iter_mut() {
        *value = 85 + *value / 3 * 2;
    }
    let mut canvas = Canvas::new(&pale)?;
    let thickness = i32::try_from(picture.width() / 600).unwrap_or(1).max(1);
    for (line, upright) in lines {
        let [from, to] = line.ends_px;
        let (colour, thickness) = if upright { (UPRIGHT, thickness + 1) } else { (OTHER, thickness) };
        canvas.line(from, to, colour, thickness)?;
    }
    canvas.finish()
}
