//! Measures the colours of tracked vehicles from the frames of an input.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use image::RgbImage;
use nalgebra::Vector2;
use roadplane_base::{TrackRow, bbox_hidden_by, bbox_part, upper_median};

use crate::stream::streaming::{open_input, stream};
use crate::{Cancel, Config, PipelineError, Progress};

/// Number of boxes per vehicle whose pixels are used. The largest boxes are chosen.
const BOXES: usize = 5;
/// Part of a box that mostly shows painted metal, not windows, road or the next car. Left, top, right and bottom, as
/// shares of the box's width and height.
const BODY: [f64; 4] = [0.25, 0.45, 0.75, 0.75];

/// Returns the RGB colour of each tracked vehicle, by the number of its track.
///
/// The colour is the median of the pixels in the middle of the vehicle's largest boxes. Pixels inside the boxes of
/// nearer vehicles do not count. Boxes at the edge of the picture are used only if there are too few other boxes. A
/// vehicle without an observed row in `rows` has no colour.
///
/// # Errors
/// Returns a [`PipelineError`] if the input cannot be read.
pub fn track_colours(
    input: &Path,
    rows: &[TrackRow],
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<BTreeMap<u64, [u8; 3]>, PipelineError> {
    let input = open_input(input, config)?;
    let size = input.size();
    let is_cut = |row: &TrackRow| {
        let [x0, y0, x1, y1] = row.bbox_px;
        let (right, bottom) = (f64::from(size.width) - 2.0, f64::from(size.height) - 2.0);
        x0 <= 1.0 || y0 <= 1.0 || x1 >= right || y1 >= bottom
    };
    let mut boxes: BTreeMap<u64, Vec<[f64; 4]>> = BTreeMap::new();
    let mut of_track: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows {
        boxes.entry(row.frame).or_default().push(row.bbox_px);
        if row.observed {
            of_track.entry(row.track).or_default().push(row);
        }
    }
    for observed in of_track.values_mut() {
        let largest = |a: &TrackRow, b: &TrackRow| area(b).total_cmp(&area(a)).then(a.frame.cmp(&b.frame));
        observed.sort_by(|a, b| is_cut(a).cmp(&is_cut(b)).then_with(|| largest(a, b)));
        observed.truncate(BOXES);
    }
    let mut of_frame: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in of_track.values().flatten() {
        of_frame.entry(row.frame).or_default().push(row);
    }
    let frames: BTreeSet<u64> = of_frame.keys().copied().collect();
    let mut pixels: BTreeMap<u64, Vec<[u8; 3]>> = BTreeMap::new();
    let read = |work: &crate::stream::flow::Work| {
        if let Some(image) = &work.image {
            for row in of_frame.get(&work.stamp.index).into_iter().flatten() {
                let there = boxes.get(&row.frame).map_or(&[][..], Vec::as_slice);
                pixels.entry(row.track).or_default().extend(body_pixels(image, &row.bbox_px, there));
            }
        }
        Ok(())
    };
    stream(input, |stamp| frames.contains(&stamp.index), Vec::new(), read, config, cancel, progress)?;
    Ok(pixels.into_iter().filter_map(|(track, pixels)| Some((track, median(pixels)?))).collect())
}

fn area(row: &TrackRow) -> f64 {
    let [x0, y0, x1, y1] = row.bbox_px;
    (x1 - x0) * (y1 - y0)
}

/// Returns the pixels of a vehicle's body in its box. Pixels inside the boxes of nearer vehicles are left out. If this
/// leaves no pixel, all pixels of the body are returned. `there` has the boxes of all vehicles in the frame.
fn body_pixels(image: &RgbImage, bbox: &[f64; 4], there: &[[f64; 4]]) -> Vec<[u8; 3]> {
    let [x0, y0, x1, y1] = bbox_part(bbox, &BODY).map(|edge| edge.round().max(0.0) as u32);
    let (columns, lines) = (x0..x1.min(image.width()), y0..y1.min(image.height()));
    let body: Vec<(u32, u32)> = lines.flat_map(|y| columns.clone().map(move |x| (x, y))).collect();
    let is_hidden = bbox_hidden_by(bbox, there);
    let is_free = |(x, y): &(u32, u32)| !is_hidden(&Vector2::new(f64::from(*x), f64::from(*y)));
    let free: Vec<(u32, u32)> = body.iter().copied().filter(is_free).collect();
    let seen = if free.is_empty() { body } else { free };
    seen.into_iter().map(|(x, y)| image.get_pixel(x, y).0).collect()
}

/// Returns the median of each colour channel; `None` if there are no pixels.
fn median(pixels: Vec<[u8; 3]>) -> Option<[u8; 3]> {
    let channel =
        |i: usize| upper_median(&mut pixels.iter().map(|pixel| pixel[i]).collect::<Vec<_>>(), u8::cmp);
    Some([channel(0)?, channel(1)?, channel(2)?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn pixels_behind_a_nearer_vehicle_count_only_if_there_are_no_others() {
        // The box is white on the left and hidden behind a black vehicle on the right.
        let image = RgbImage::from_fn(100, 100, |x, _| if x < 38 { Rgb([240; 3]) } else { Rgb([10; 3]) });
        let bbox = [0.0, 20.0, 80.0, 60.0];
        let nearer = [40.0, 30.0, 99.0, 90.0];
        let colour = |there: &[[f64; 4]]| median(body_pixels(&image, &bbox, there));
        assert_eq!(colour(&[bbox, nearer]), Some([240; 3]));
        assert_eq!(
            colour(&[bbox, [40.0, 0.0, 99.0, 50.0]]),
            Some([10; 3]),
            "farther away, it covers nothing"
        );
        assert_eq!(colour(&[bbox, [0.0, 0.0, 99.0, 99.0]]), Some([10; 3]));
    }
}
