//! Drawing of the edges of a scene into its picture.

use image::RgbImage;
use roadplane_base::SceneLine;

use crate::ViewError;
use crate::canvas::{Canvas, Rgb};

/// Colour of vertical edges.
const VERTICAL: Rgb = [40, 200, 60];
/// Colour of other edges.
const OTHER: Rgb = [200, 60, 50];

/// Draws edges into a pale copy of the picture. The flag of an edge is true if the edge is vertical in the scene.
/// Vertical edges are green, and other edges are red.
///
/// # Errors
/// [`ViewError::Drawing`].
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
    for (line, is_vertical) in lines {
        let [from, to] = line.ends_px;
        let (colour, thickness) = if is_vertical { (VERTICAL, thickness + 1) } else { (OTHER, thickness) };
        canvas.line(from, to, colour, thickness)?;
    }
    canvas.finish()
}
