//! What colour tracked vehicles have in the picture.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use image::RgbImage;
use roadplane_base::TrackRow;

use crate::streaming::{open_input, stream};
use crate::{Cancel, Config, PipelineError, Progress};

/// Looks at each vehicle: its largest.
const LOOKS: usize = 5;
/// The part of a box that shows sheet metal rather than windows, road or the next car: left, top, right, bottom, as shares.
const BODY: [f64; 4] = [0.25, 0.45, 0.75, 0.75];

/// The colour of each track, RGB: the median over the middle of its largest boxes. Tracks that were never seen whole have none.
///
/// # Errors
/// [`PipelineError`] where the input cannot be read.
pub fn track_colours(
    input: &Path,
    rows: &[TrackRow],
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<BTreeMap<u64, [u8; 3]>, PipelineError> {
    let input = open_input(input, config)?;
    let size = input.size();
    let whole = |row: &&TrackRow| {
        let [x0, y0, x1, y1] = row.bbox_px;
        let (right, bottom) = (f64::from(size.width) - 2.0, f64::from(size.height) - 2.0);
        row.observed && x0 > 1.0 && y0 > 1.0 && x1 < right && y1 < bottom
    };
    let mut of_track: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows.iter().filter(whole) {
        of_track.entry(row.track).or_default().push(row);
    }
    for looks in of_track.values_mut() {
        looks.sort_by(|a, b| area(b).total_cmp(&area(a)).then(a.frame.cmp(&b.frame)));
        looks.truncate(LOOKS);
    }
    let mut of_frame: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in of_track.values().flatten() {
        of_frame.entry(row.frame).or_default().push(row);
    }
    let frames: BTreeSet<u64> = of_frame.keys().copied().collect();
    let mut pixels: BTreeMap<u64, Vec<[u8; 3]>> = BTreeMap::new();
    let look = |work: &crate::flow::Work| {
        if let Some(image) = &work.image {
            for row in of_frame.get(&work.stamp.index).into_iter().flatten() {
                pixels.entry(row.track).or_default().extend(body_pixels(image, row));
            }
        }
        Ok(())
    };
    stream(input, |stamp| frames.contains(&stamp.index), Vec::new(), look, config, cancel, progress)?;
    Ok(pixels.into_iter().filter_map(|(track, pixels)| Some((track, median(pixels)?))).collect())
}

fn area(row: &TrackRow) -> f64 {
    let [x0, y0, x1, y1] = row.bbox_px;
    (x1 - x0) * (y1 - y0)
}

fn body_pixels(image: &RgbImage, row: &TrackRow) -> Vec<[u8; 3]> {
    let [x0, y0, x1, y1] = row.bbox_px;
    let at = |low: f64, high: f64, share: f64| (low + share * (high - low)).round().max(0.0) as u32;
    let columns = at(x0, x1, BODY[0])..at(x0, x1, BODY[2]).min(image.width());
    let lines = at(y0, y1, BODY[1])..at(y0, y1, BODY[3]).min(image.height());
    lines.flat_map(|y| columns.clone().map(move |x| image.get_pixel(x, y).0)).collect()
}

/// Channel by channel.
fn median(pixels: Vec<[u8; 3]>) -> Option<[u8; 3]> {
    let channel = |i: usize| {
        let mut values: Vec<u8> = pixels.iter().map(|pixel| pixel[i]).collect();
        values.sort_unstable();
        values.get(values.len() / 2).copied()
    };
    Some([channel(0)?, channel(1)?, channel(2)?])
}
