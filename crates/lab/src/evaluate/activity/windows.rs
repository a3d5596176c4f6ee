//! Windows of a video for the table's video row: a fixed square around a vehicle for 3 s.
//!
//! `scripts/train/activity/windows.py` cuts the same windows; `tests/data/activity/windows.json` tests both.

use image::RgbImage;

/// Number of steps of a window.
pub(super) const STEPS: usize = 16;
/// Number of steps before the window's own step. The square lies around the box of the own step.
pub(super) const BEFORE: i64 = 8;
/// Number of steps that a window predicts.
pub(super) const PREDICTED: usize = 4;
/// Number of predicted steps before the window's own step.
pub(super) const PREDICTED_BEFORE: i64 = 2;
/// Width and height of a crop, the net's input for one step, px.
pub(super) const SIDE_PX: usize = 48;
/// Bytes of a crop: RGB, row by row.
pub(super) const CROP_BYTES: usize = SIDE_PX * SIDE_PX * 3;
/// Side of the square over the longer side of the vehicle's box.
const REACH: f64 = 2.5;
/// Samples per pixel of a crop, along each side.
const SUB: usize = 3;

/// A square of a picture, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Square {
    left: f64,
    top: f64,
    side: f64,
}

impl Square {
    /// Returns the square around a box.
    pub fn around([x0, y0, x1, y1]: [f64; 4]) -> Self {
        let side = (REACH * (x1 - x0).max(y1 - y0)).max(8.0);
        Self { left: (x0 + x1 - side) / 2.0, top: (y0 + y1 - side) / 2.0, side }
    }

    /// Cuts the square out of a picture and scales it to [`SIDE_PX`]. Beyond the picture's edge the edge pixels repeat.
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

    /// Size of a picture that is made by a formula, boxes, and every fifth pixel of every fifth row of their crops.
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
