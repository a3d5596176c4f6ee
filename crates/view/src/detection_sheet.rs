//! A sheet of pictures with the boxes that a detector found, missed and invented.

use image::RgbImage;
use image::imageops::{FilterType, replace, resize};
use nalgebra::Vector2;

use crate::ViewError;
use crate::canvas::{Canvas, Rgb};

/// Width of a picture on the sheet, px.
const WIDTH_PX: u32 = 800;
/// Number of pictures per row.
const COLUMNS: usize = 2;
/// Colour of boxes that found a vehicle.
const FOUND: Rgb = [90, 255, 90];
/// Colour of vehicles that were missed.
const MISSED: Rgb = [255, 220, 60];
/// Colour of false boxes.
const WRONG: Rgb = [255, 70, 70];

/// A picture with its boxes: left, top, right, bottom, px.
#[derive(Clone, Debug)]
pub struct DetectionCase {
    /// The picture.
    pub picture: RgbImage,
    /// Title above the picture.
    pub title: String,
    /// Boxes that found a vehicle.
    pub found: Vec<[f64; 4]>,
    /// True boxes of vehicles that were missed.
    pub missed: Vec<[f64; 4]>,
    /// Boxes without a vehicle.
    pub wrong: Vec<[f64; 4]>,
}

/// Draws a sheet with all cases: found boxes are green, missed vehicles are yellow, and false boxes are red.
///
/// # Errors
/// [`ViewError::Drawing`].
pub fn detection_sheet(cases: &[DetectionCase]) -> Result<RgbImage, ViewError> {
    let tiles = cases.iter().map(tile).collect::<Result<Vec<_>, _>>()?;
    let heights: Vec<u32> =
        tiles.chunks(COLUMNS).map(|row| row.iter().map(RgbImage::height).max().unwrap_or(0)).collect();
    let width = WIDTH_PX * u32::try_from(COLUMNS).unwrap_or(1);
    let mut sheet = RgbImage::from_pixel(width, heights.iter().sum::<u32>().max(1), image::Rgb([40; 3]));
    let mut top = 0;
    for (row, height) in tiles.chunks(COLUMNS).zip(heights) {
        for (column, tile) in (0..).zip(row) {
            replace(&mut sheet, tile, column * i64::from(WIDTH_PX), top);
        }
        top += i64::from(height);
    }
    Ok(sheet)
}

fn tile(case: &DetectionCase) -> Result<RgbImage, ViewError> {
    let scale = f64::from(WIDTH_PX) / f64::from(case.picture.width().max(1));
    let height = (f64::from(case.picture.height()) * scale).round().max(1.0) as u32;
    let mut canvas = Canvas::new(&resize(&case.picture, WIDTH_PX, height, FilterType::Triangle))?;
    for (boxes, colour) in [(&case.found, FOUND), (&case.missed, MISSED), (&case.wrong, WRONG)] {
        for [x0, y0, x1, y1] in boxes {
            let corners = [[*x0, *y0], [*x1, *y0], [*x1, *y1], [*x0, *y1]].map(|c| Vector2::from(c) * scale);
            for i in 0..4 {
                canvas.line(corners[i], corners[(i + 1) % 4], colour, 2)?;
            }
        }
    }
    canvas.label(&case.title, Vector2::new(0.0, 0.0), [230, 230, 230], 0.5)?;
    canvas.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_have_the_colour_of_their_kind() {
        let picture = RgbImage::from_pixel(400, 200, image::Rgb([9; 3]));
        let case = DetectionCase {
            picture,
            title: String::new(),
            found: vec![[20.0, 60.0, 60.0, 90.0]],
            missed: vec![[120.0, 60.0, 160.0, 90.0]],
            wrong: vec![[220.0, 60.0, 260.0, 90.0]],
        };
        let sheet = detection_sheet(&[case.clone(), case.clone(), case]).unwrap();
        assert_eq!(sheet.dimensions(), (1600, 800));
        for (x, colour) in [(40, FOUND), (140, MISSED), (240, WRONG)] {
            assert_eq!(sheet.get_pixel(2 * x, 120).0, colour);
            assert_eq!(sheet.get_pixel(800 + 2 * x, 120).0, colour);
        }
    }
}
