//! A picture into which OpenCV draws.

use image::RgbImage;
use nalgebra::Vector2;
use opencv::core::{Mat, MatTraitConst as _, MatTraitConstManual as _, Point, Rect, Scalar, Vec3b};
use opencv::imgproc;

use crate::ViewError;

/// Number of fractional bits of pixel coordinates. With 4 bits, positions are rounded to 1/16 px.
const SUB_PIXEL_BITS: i32 = 4;
/// Font of labels.
const FONT: i32 = imgproc::FONT_HERSHEY_SIMPLEX;

/// A colour: red, green, blue, 0 to 255 each.
pub type Rgb = [u8; 3];

/// A copy of a picture to draw into. Positions are in px. The centre of the top left pixel is (0, 0).
pub(crate) struct Canvas(Mat);

impl Canvas {
    /// Creates a canvas with a copy of a picture.
    pub fn new(picture: &RgbImage) -> Result<Self, ViewError> {
        let rows = Mat::from_slice(picture.as_raw())?;
        Ok(Self(rows.reshape(3, i32::try_from(picture.height()).unwrap_or(0))?.try_clone()?))
    }

    /// Returns the finished picture.
    pub fn finish(self) -> Result<RgbImage, ViewError> {
        let bytes = self.0.data_typed::<Vec3b>()?.iter().flat_map(|pixel| pixel.0).collect();
        let (width, height) = (self.0.cols() as u32, self.0.rows() as u32);
        RgbImage::from_raw(width, height, bytes)
            .ok_or_else(|| opencv::Error::new(0, "the size of a picture does not match its pixels").into())
    }

    /// Draws a line. A line with an end far outside the picture is not drawn.
    pub fn line(
        &mut self,
        from: Vector2<f64>,
        to: Vector2<f64>,
        colour: Rgb,
        thickness: i32,
    ) -> Result<(), ViewError> {
        let fine = f64::from(1 << SUB_PIXEL_BITS);
        let (Some(from), Some(to)) = (point(from, fine), point(to, fine)) else { return Ok(()) };
        let colour = scalar(colour);
        imgproc::line(&mut self.0, from, to, colour, thickness, imgproc::LINE_AA, SUB_PIXEL_BITS)?;
        Ok(())
    }

    /// Draws the outline of a circle.
    pub fn circle(&mut self, centre: Vector2<f64>, radius_px: f64, colour: Rgb) -> Result<(), ViewError> {
        let fine = f64::from(1 << SUB_PIXEL_BITS);
        let Some(centre) = point(centre, fine) else { return Ok(()) };
        let radius = (radius_px * fine).round() as i32;
        imgproc::circle(&mut self.0, centre, radius, scalar(colour), 1, imgproc::LINE_AA, SUB_PIXEL_BITS)?;
        Ok(())
    }

    /// Returns the width and height of the picture, px.
    pub fn size(&self) -> [f64; 2] {
        [f64::from(self.0.cols()), f64::from(self.0.rows())]
    }

    /// Returns the width and height of a label with its background, px.
    pub fn label_size(&self, text: &str, size: f64) -> Result<[f64; 2], ViewError> {
        Ok(label_extent(text, size)?.map(f64::from))
    }

    /// Draws black text on a rectangle with the colour `colour`. The lower left corner of the rectangle is at `at`. The
    /// rectangle is moved into the picture if necessary.
    pub fn label(&mut self, text: &str, at: Vector2<f64>, colour: Rgb, size: f64) -> Result<(), ViewError> {
        let [width, height] = label_extent(text, size)?;
        let inside = |v: f64, low: i32, high: i32| f64::from(low).max(v.min(f64::from(high)));
        let corner =
            Vector2::new(inside(at.x, 0, self.0.cols() - width), inside(at.y, height, self.0.rows() - 1));
        let Some(at) = point(corner, 1.0) else { return Ok(()) };
        let plate = Rect::new(at.x, at.y - height, width, height);
        imgproc::rectangle(&mut self.0, plate, scalar(colour), imgproc::FILLED, imgproc::LINE_8, 0)?;
        let origin = Point::new(at.x + 2, at.y - 3);
        let black = scalar([0; 3]);
        imgproc::put_text(&mut self.0, text, origin, FONT, size, black, 1, imgproc::LINE_AA, false)?;
        Ok(())
    }
}

fn label_extent(text: &str, size: f64) -> Result<[i32; 2], ViewError> {
    let mut descent = 0;
    let extent = imgproc::get_text_size(text, FONT, size, 1, &mut descent)?;
    Ok([extent.width + 5, extent.height + 6])
}

fn scalar([r, g, b]: Rgb) -> Scalar {
    Scalar::new(f64::from(r), f64::from(g), f64::from(b), 0.0)
}

/// Converts a pixel to OpenCV's fixed-point coordinates, in units of 1/`fine` px.
///
/// Returns `None` if the absolute value of a coordinate is 20 000 px or more.
fn point(pixel: Vector2<f64>, fine: f64) -> Option<Point> {
    let sane = pixel.iter().all(|v| v.abs() < 20_000.0);
    sane.then(|| Point::new((pixel.x * fine).round() as i32, (pixel.y * fine).round() as i32))
}
