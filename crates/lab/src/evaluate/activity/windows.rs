//! Windows of a video for the video row of the table of activities. A window shows a fixed square around a vehicle for
//! 3 s.
//!
//! `scripts/train/activity/windows.py` cuts the same windows. The tests of both compare with
//! `tests/data/activity/windows.json`.

use image::RgbImage;

/// Number of time steps in a window.
pub(super) const STEPS: usize = 16;
/// Number of time steps before the window's reference step. The square surrounds the vehicle's box at the reference
/// step.
pub(super) const BEFORE: i64 = 8;
/// Number of time steps whose labels the net predicts from a window.
pub(super) const PREDICTED: usize = 4;
/// Number of predicted time steps before the window's reference step.
pub(super) const PREDICTED_BEFORE: i64 = 2;
/// Width and height of a crop, px. A crop is the net's input for one time step.
pub(super) const SIDE_PX: usize = 48;
/// Number of bytes of a crop: RGB, row by row.
pub(super) const CROP_BYTES: usize = SIDE_PX * SIDE_PX * 3;
/// Ratio of the square's side to the longer side of the vehicle's box.
const REACH: f64 = 2.5;
/// Number of samples per pixel of a crop, along each axis.
const SUB: usize = 3;

/// A square in a picture: left edge, top edge and side, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Square {
    left: f64,
    top: f64,
    side: f64,
}

impl Square {
    /// Returns the square around a vehicle's box (left, top, right, bottom, px).
    pub fn around([x0, y0, x1, y1]: [f64; 4]) -> Self {
        let side = (REACH * (x1 - x0).max(y1 - y0)).max(8.0);
        Self { left: (x0 + x1 - side) / 2.0, top: (y0 + y1 - side) / 2.0, side }
    }

    /// Cuts the square out of a picture and scales it to a crop with sides of [`SIDE_PX`] pixels.
    ///
    /// Outside the picture, the pixels at the picture's edge repeat.
    pub fn cut(&self, picture: &RgbImage, crop: &mut [u8]) {
        let samples = |from: f64, size: u32| -> Vec<u32> {
            let at = |k| (k as f64 + 0.5) / (SUB * SIDE_PX) as f64 * self.side;
            let nearest = |k| (from + at(k) + 0.5).floor().clamp(0.0, f64::from(size.max(1) - 1));
            (0..SUB * SIDE_PX).map(|k| nearest(k) as u32).collect()
        };
        let (columns, rows) = (samples(self.left, picture.width()), samples(self.top, picture.height()));
        let mut cells = crop.chunks_exact_mut(3);
        for rows in rows.chunks_exact(SUB) {
            for (columns, cell) in columns.chunks_exact(SUB).zip(&mut cells) {
                let mut sum = [0_usize; 3];
                for (x, y) in rows.iter().flat_map(|y| columns.iter().map(move |x| (*x, *y))) {
                    sum.iter_mut().zip(picture.get_pixel(x, y).0).for_each(|(sum, v)| *sum += usize::from(v));
                }
                for (cell, sum) in cell.iter_mut().zip(sum) {
                    *cell = ((sum + SUB * SUB / 2) / (SUB * SUB)) as u8;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    /// The content of the test file: the size of a picture that a formula fills, and cases with a box and pixels of its
    /// crop.
    ///
    /// The pixels are every fifth pixel of every fifth row of the crop.
    #[derive(Deserialize)]
    struct Fixture {
        size_px: [u32; 2],
        cases: Vec<Case>,
    }

    #[derive(Deserialize)]
    struct Case {
        #[serde(rename = "box")]
        bbox: [f64; 4],
        crop: Vec<[u8; 3]>,
    }

    #[test]
    fn crops_equal_those_of_the_training() {
        let fixture = include_str!("../../../../../tests/data/activity/windows.json");
        let fixture: Fixture = serde_json::from_str(fixture).unwrap();
        let [width, height] = fixture.size_px;
        let picture = RgbImage::from_fn(width, height, |x, y| {
            image::Rgb([(x * 7 + y * y) % 251, (x * x + y * 3) % 241, (x * y) % 239].map(|v| v as u8))
        });
        assert!(fixture.cases.len() >= 3);
        for case in fixture.cases {
            let mut crop = vec![0; CROP_BYTES];
            Square::around(case.bbox).cut(&picture, &mut crop);
            let of = |row: usize, column: usize| &crop[(row * SIDE_PX + column) * 3..][..3];
            let cells = (0..SIDE_PX)
                .step_by(5)
                .flat_map(|row| (0..SIDE_PX).step_by(5).map(move |column| (row, column)));
            let found: Vec<&[u8]> = cells.map(|(row, column)| of(row, column)).collect();
            assert_eq!(found, case.crop, "{:?}", case.bbox);
        }
    }
}
