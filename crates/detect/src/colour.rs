//! Measures the colour of boxes. The tracker compares it, as other vehicles rarely have the same colour.

use image::RgbImage;
use nalgebra::Vector2;
use roadplane_base::{FrameRecord, bbox_hidden_by, bbox_part};

/// Part of a box whose colour is measured: left, top, right, bottom, as shares of its width and height. The road beside a
/// vehicle is mostly outside. Its lower middle alone, or medians, tell vehicles apart as well (16 rendered streets).
const MIDDLE: [f64; 4] = [0.15, 0.15, 0.85, 0.85];
/// Number of points in each row and in each column at which the colour is read.
const POINTS: usize = 14;

/// Measures the colours of a frame's boxes in its picture, if they have none yet. A box that nearer vehicles hide keeps
/// none.
pub fn measure_colours(image: &RgbImage, frame: &mut FrameRecord) {
    let boxes: Vec<[f64; 4]> = frame.cars.iter().map(|car| car.bbox_px).collect();
    let cars = frame.cars.iter_mut().map(|car| (&car.bbox_px, &mut car.colour_rgb));
    let weak = frame.weak.iter_mut().map(|weak| (&weak.bbox_px, &mut weak.colour_rgb));
    for (bbox_px, own) in cars.chain(weak) {
        *own = own.or_else(|| colour(image, bbox_px, &boxes));
    }
}

/// Returns the mean colour of a box where no other box hides it.
fn colour(image: &RgbImage, bbox_px: &[f64; 4], others: &[[f64; 4]]) -> Option<[u8; 3]> {
    let [x0, y0, x1, y1] = bbox_part(bbox_px, &MIDDLE);
    let is_hidden = bbox_hidden_by(bbox_px, others);
    let (mut sum, mut count) = ([0_u32; 3], 0);
    let at = |low: f64, high: f64, i: usize| low + (i as f64 + 0.5) / POINTS as f64 * (high - low);
    for point in (0..POINTS * POINTS).map(|i| Vector2::new(at(x0, x1, i % POINTS), at(y0, y1, i / POINTS))) {
        if point.min() < 0.0 || is_hidden(&point) {
            continue;
        }
        let Some(pixel) = image.get_pixel_checked(point.x as u32, point.y as u32) else { continue };
        sum.iter_mut().zip(pixel.0).for_each(|(sum, value)| *sum += u32::from(value));
        count += 1;
    }
    (count > 0).then(|| sum.map(|sum| ((sum + count / 2) / count) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn the_colour_is_that_of_the_part_that_no_nearer_box_hides() {
        // The picture is red on the left and blue on the right.
        let image = RgbImage::from_fn(100, 60, |x, _| Rgb(if x < 50 { [200, 0, 0] } else { [0, 0, 100] }));
        let whole = [0.0, 0.0, 100.0, 50.0];
        assert_eq!(colour(&image, &whole, &[whole]), Some([100, 0, 50]));
        let nearer = [50.0, 10.0, 100.0, 60.0];
        assert_eq!(colour(&image, &[0.0, 10.0, 100.0, 50.0], &[nearer]), Some([200, 0, 0]));
        assert_eq!(
            colour(&image, &nearer, &[whole, nearer]),
            Some([0, 0, 100]),
            "the other box is farther away"
        );
        assert_eq!(colour(&image, &whole, &[[-1.0, -1.0, 101.0, 60.0]]), None, "all of it is hidden");
        assert_eq!(colour(&image, &[200.0, 0.0, 220.0, 20.0], &[]), None, "it is outside the picture");
    }
}
