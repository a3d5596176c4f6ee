//! Windows of a video for the table's video row: what a camera shows of a fixed square around a vehicle for 3 s.
//!
//! `scripts/train/activity/windows.py` cuts them alike; both are held to `tests/data/activity/windows.json`.

use image::RgbImage;

/// Steps of a window.
pub(super) const STEPS: usize = 16;
/// Of these before the window's own, around whose box its square lies.
pub(super) const BEFORE: i64 = 8;
/// Steps that it tells.
pub(super) const TOLD: usize = 4;
/// Of these before its own.
pub(super) const TOLD_BEFORE: i64 = 2;
/// Width and height of what a net sees of a step, px.
pub(super) const SIDE_PX: usize = 48;
/// Bytes of that: RGB, row by row.
pub(super) const CROP_BYTES: usize = SIDE_PX * SIDE_PX * 3;
/// Side of the square over the longer side of the vehicle's box.
const REACH: f64 = 2.5;
/// Samples of a pixel, to each side.
const SUB: usize = 3;

/// A square of a picture, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Square {
    left: f64,
    top: f64,
    side: f64,
}

impl Square {
    /// The one around a box.
    pub fn around([x0, y0, x1, y1]: [f64; 4]) -> Self {
        let side = (REACH * (x1 - x0).max(y1 - y0)).max(8.0);
        Self { left: (x0 + x1 - side) / 2.0, top: (y0 + y1 - side) / 2.0, side }
    }

    /// What a picture shows in it, scaled to [`SIDE_PX`]; beyond its edge the picture goes on as there.
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

    /// A picture by formula, boxes, and of their crops every fifth pixel of every fifth row.
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
    fn the_nets_see_what_they_learnt_from() {
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
            let places = (0..SIDE_PX)
                .step_by(5)
                .flat_map(|row| (0..SIDE_PX).step_by(5).map(move |column| (row, column)));
            let found: Vec<&[u8]> = places.map(|(row, column)| of(row, column)).collect();
            assert_eq!(found, case.crop, "{:?}", case.bbox);
        }
    }
}
