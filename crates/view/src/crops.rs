//! The largest view of each track in the sample frames, cut out and enlarged.

use std::collections::BTreeMap;

use image::RgbImage;
use image::imageops::{FilterType, crop_imm, resize};
use roadplane_base::TrackRow;

/// Width and height of a cut-out in the page, px.
const CROP_PX: (u32, u32) = (300, 200);
/// Size of the cut-out divided by the size of the vehicle's box.
const AROUND: f64 = 1.25;

/// A picture of one track, cut out of a sample frame.
#[derive(Debug)]
pub(crate) struct Crop {
    pub track: u64,
    pub frame: u64,
    pub picture: RgbImage,
}

/// Cuts each track out of the sample frame in which its box is largest. `samples` contains frames with their indices.
///
/// Rows without a detection are ignored. The result is sorted by track number.
pub(crate) fn best_views(rows: &[TrackRow], samples: &[(u64, RgbImage)]) -> Vec<Crop> {
    let area = |row: &TrackRow| (row.bbox_px[2] - row.bbox_px[0]) * (row.bbox_px[3] - row.bbox_px[1]);
    let mut best: BTreeMap<u64, (&TrackRow, &RgbImage)> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.observed) {
        let Some((_, picture)) = samples.iter().find(|(frame, _)| *frame == row.frame) else { continue };
        let kept = best.entry(row.track).or_insert((row, picture));
        if area(row) > area(kept.0) {
            *kept = (row, picture);
        }
    }
    best.into_iter()
        .filter_map(|(track, (row, picture))| {
            Some(Crop { track, frame: row.frame, picture: cut_out(picture, row.bbox_px)? })
        })
        .collect()
}

/// Cuts out a box with its surroundings and resizes the cut-out to [`CROP_PX`].
///
/// A cut-out that would cross the edge of the picture is moved inwards. Returns `None` if the cut-out is empty.
fn cut_out(picture: &RgbImage, [x0, y0, x1, y1]: [f64; 4]) -> Option<RgbImage> {
    let shape = f64::from(CROP_PX.0) / f64::from(CROP_PX.1);
    let (full_width, full_height) = (f64::from(picture.width()), f64::from(picture.height()));
    let width = (AROUND * (x1 - x0).max((y1 - y0) * shape)).clamp(12.0, full_width.max(12.0));
    let height = (width / shape).min(full_height);
    let left = ((x0 + x1 - width) / 2.0).clamp(0.0, (full_width - width).max(0.0));
    let top = ((y0 + y1 - height) / 2.0).clamp(0.0, (full_height - height).max(0.0));
    let part = crop_imm(picture, left as u32, top as u32, width as u32, height as u32).to_image();
    let usable = part.width() > 0 && part.height() > 0;
    usable.then(|| resize(&part, CROP_PX.0, CROP_PX.1, FilterType::CatmullRom))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    fn row(track: u64, frame: u64, bbox_px: [f64; 4], observed: bool) -> TrackRow {
        TrackRow { bbox_px, observed, ..roadplane_synth::stationary_row(track, frame, 0.0) }
    }

    #[test]
    fn the_largest_observed_box_is_shown_even_at_the_edge() {
        let (red, blue) = (Rgb([255, 0, 0]), Rgb([0, 0, 255]));
        let samples = [(0, RgbImage::from_pixel(640, 480, red)), (8, RgbImage::from_pixel(640, 480, blue))];
        let rows = [
            row(1, 0, [10.0, 10.0, 60.0, 40.0], true),
            row(1, 8, [600.0, 440.0, 700.0, 500.0], true),
            row(2, 0, [10.0, 10.0, 60.0, 40.0], true),
            row(2, 8, [10.0, 10.0, 600.0, 400.0], false),
            row(3, 5, [10.0, 10.0, 600.0, 400.0], true),
        ];
        let crops = best_views(&rows, &samples);
        let shown: Vec<(u64, u64)> = crops.iter().map(|crop| (crop.track, crop.frame)).collect();
        assert_eq!(shown, [(1, 8), (2, 0)], "track 3 is in no sample frame");
        assert_eq!(*crops[0].picture.get_pixel(150, 100), blue);
        assert_eq!(crops[1].picture.dimensions(), CROP_PX);
    }

    #[test]
    fn a_tiny_picture_has_a_cut_out() {
        assert!(cut_out(&RgbImage::new(3, 3), [0.0, 0.0, 3.0, 3.0]).is_some());
    }
}
