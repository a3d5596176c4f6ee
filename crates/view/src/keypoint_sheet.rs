//! A sheet with enlarged pictures of cars and their true and predicted keypoints.

use image::RgbImage;
use image::imageops::{FilterType, crop_imm, replace, resize};
use nalgebra::Vector2;

use crate::ViewError;
use crate::canvas::{Canvas, Rgb};

/// Side of a cut-out, px.
const SIDE_PX: u32 = 320;
/// Number of cut-outs per row.
const COLUMNS: u32 = 4;
/// Side of the cut-out divided by the longer side of the car's box.
const AROUND: f64 = 1.3;
/// Colour of true keypoints.
const TRUE: Rgb = [90, 255, 90];
/// Colour of predicted keypoints.
const PREDICTED: Rgb = [255, 80, 80];

/// A car on the sheet.
#[derive(Clone, Debug)]
pub struct KeypointCase<'a> {
    /// Picture that contains the car.
    pub picture: &'a RgbImage,
    /// Box of the car: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Pairs of true and predicted keypoints, px.
    pub pairs: Vec<(Vector2<f64>, Vector2<f64>)>,
    /// Title above the car.
    pub title: String,
}

/// Draws a sheet with all cases. Green circles mark true keypoints, and red crosses mark predicted keypoints. A line
/// joins the two keypoints of each pair.
///
/// # Errors
/// [`ViewError::Drawing`].
pub fn keypoint_sheet(cases: &[KeypointCase<'_>]) -> Result<RgbImage, ViewError> {
    let rows = u32::try_from(cases.len()).unwrap_or(0).div_ceil(COLUMNS).max(1);
    let mut sheet = RgbImage::from_pixel(COLUMNS * SIDE_PX, rows * SIDE_PX, image::Rgb([40; 3]));
    for (slot, case) in (0..).zip(cases) {
        let (x, y) = (slot % COLUMNS * SIDE_PX, slot / COLUMNS * SIDE_PX);
        replace(&mut sheet, &cut_out(case)?, i64::from(x), i64::from(y));
    }
    Ok(sheet)
}

fn cut_out(case: &KeypointCase<'_>) -> Result<RgbImage, ViewError> {
    let [x0, y0, x1, y1] = case.bbox_px;
    let side = (AROUND * (x1 - x0).max(y1 - y0)).ceil().max(4.0);
    let corner = Vector2::new((x0 + x1 - side) / 2.0, (y0 + y1 - side) / 2.0).map(|v| v.max(0.0).floor());
    let part = crop_imm(case.picture, corner.x as u32, corner.y as u32, side as u32, side as u32).to_image();
    let scale = f64::from(SIDE_PX) / f64::from(part.width().max(part.height()).max(1));
    let [width, height] =
        [part.width(), part.height()].map(|n| (f64::from(n) * scale).round().max(1.0) as u32);
    let mut square = RgbImage::from_pixel(SIDE_PX, SIDE_PX, image::Rgb([40; 3]));
    replace(&mut square, &resize(&part, width, height, FilterType::CatmullRom), 0, 0);
    let mut canvas = Canvas::new(&square)?;
    let enlarged =
        |pixel: &Vector2<f64>| (pixel - corner + Vector2::repeat(0.5)) * scale - Vector2::repeat(0.5);
    for (true_pixel, predicted) in &case.pairs {
        let (at, to) = (enlarged(true_pixel), enlarged(predicted));
        canvas.line(at, to, PREDICTED, 1)?;
        canvas.circle(at, 4.0, TRUE)?;
        for arm in [Vector2::new(3.0, 3.0), Vector2::new(3.0, -3.0)] {
            canvas.line(to - arm, to + arm, PREDICTED, 1)?;
        }
    }
    canvas.label(&case.title, Vector2::new(0.0, 0.0), [230, 230, 230], 0.42)?;
    canvas.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn true_and_predicted_keypoints_are_at_their_pixels() {
        let picture = RgbImage::from_pixel(200, 100, image::Rgb([9; 3]));
        let case = KeypointCase {
            picture: &picture,
            bbox_px: [60.0, 20.0, 110.0, 60.0],
            pairs: vec![(Vector2::new(70.0, 40.0), Vector2::new(90.0, 40.0))],
            title: "car".to_owned(),
        };
        let sheet = keypoint_sheet(&[case.clone(), case]).unwrap();
        assert_eq!(sheet.dimensions(), (4 * 320, 320));
        // The square of 65 px around the box starts at (52, 7) and is enlarged 320 / 65 times.
        let column = |x: f64| ((x - 52.0 + 0.5) * 320.0 / 65.0) as u32;
        let row = (33.5 * 320.0 / 65.0) as u32;
        let red = sheet.get_pixel(column(80.0), row);
        assert!(red.0[0] > 150 && red.0[1] < 120, "{red:?}");
        let green = sheet.get_pixel(320 + column(70.0) - 4, row);
        assert!(green.0[1] > 120, "{green:?}");
    }
}
