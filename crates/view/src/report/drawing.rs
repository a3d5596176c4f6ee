//! The part of the report in which a user draws gates, zones, lengths and surveyed points on a frame, and saves them as
//! files. The scripts `drawing*.js` do all the work in the browser.
//!
//! If the browser runs no scripts, the part is hidden.

use serde::Serialize;

use super::input::{PlainFrame, ReportInput};
use super::pictures::data_uri_up_to;
use crate::ViewError;

/// Largest width of a frame to draw on, px. A larger frame is reduced to this width. The files keep its full size.
const MAX_WIDTH: u32 = 1920;
/// JPEG quality of a frame to draw on, 0 to 100.
const QUALITY: u8 = 72;
/// Largest number of frames to draw on.
const MAX_FRAMES: usize = 3;
/// HTML markup of the part.
const MARKUP: &str = include_str!("drawing.html");
/// Style sheet of the part.
pub(super) const STYLE: &str = include_str!("drawing.css");
/// Scripts of the part, in the order in which they run.
const SCRIPTS: [&str; 5] = [
    include_str!("drawing_files.js"),
    include_str!("drawing_model.js"),
    include_str!("drawing_picture.js"),
    include_str!("drawing_list.js"),
    include_str!("drawing.js"),
];

/// The data of the part, as JSON in the page.
#[derive(Serialize)]
struct Data {
    /// Width and height of the input's pictures, px.
    size: [u32; 2],
    /// Whether the camera moves within a segment. A pixel then belongs to one frame only.
    moving: bool,
    stills: Vec<Still>,
}

/// A frame to draw on. The picture may be smaller than the frame.
#[derive(Serialize)]
struct Still {
    frame: u64,
    time: f64,
    /// Number of the camera's segment; null if the camera was not estimated.
    segment: Option<usize>,
    picture: String,
}

/// Returns the HTML of the part. The text is empty if there is no frame to draw on.
pub(super) fn drawing(input: &ReportInput<'_>) -> Result<String, ViewError> {
    let Some(first) = input.frames.first() else { return Ok(String::new()) };
    let still = |plain: &PlainFrame<'_>| {
        Ok(Still {
            frame: plain.frame,
            time: (plain.time_s * 1e3).round() / 1e3,
            segment: plain.segment,
            picture: data_uri_up_to(plain.picture, MAX_WIDTH, QUALITY)?,
        })
    };
    let data = Data {
        size: first.picture.dimensions().into(),
        moving: input.still_motion.iter().any(Option::is_some),
        stills: chosen(input.frames).into_iter().map(still).collect::<Result<_, ViewError>>()?,
    };
    // A script element ends at the first end tag, even within a string. So `<` is escaped.
    let json = serde_json::to_string(&data)
        .map_err(|source| ViewError::Data { what: source.to_string() })?
        .replace('<', "\\u003c");
    let scripts = SCRIPTS.concat();
    Ok(format!(
        "{MARKUP}<script type=\"application/json\" id=\"draw-data\">{json}</script>\n<script>\n{scripts}</script>\n"
    ))
}

/// Returns at most [`MAX_FRAMES`] frames, sorted by frame. The first frame of each segment has precedence.
fn chosen<'a>(frames: &'a [PlainFrame<'a>]) -> Vec<&'a PlainFrame<'a>> {
    let is_first = |i: usize| i == 0 || frames[i - 1].segment != frames[i].segment;
    let (firsts, others): (Vec<usize>, Vec<usize>) = (0..frames.len()).partition(|i| is_first(*i));
    let mut indices: Vec<usize> = firsts.into_iter().chain(others).take(MAX_FRAMES).collect();
    indices.sort_unstable();
    indices.into_iter().map(|i| &frames[i]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    #[test]
    fn each_segment_has_a_frame_if_there_is_room() {
        let picture = RgbImage::new(8, 8);
        let frames: Vec<PlainFrame<'_>> = [0, 0, 0, 1, 1]
            .iter()
            .zip(0..)
            .map(|(&segment, frame)| PlainFrame {
                frame,
                time_s: 0.0,
                segment: Some(segment),
                picture: &picture,
            })
            .collect();
        let kept: Vec<u64> = chosen(&frames).iter().map(|plain| plain.frame).collect();
        assert_eq!(kept, [0, 1, 3]);
        assert!(chosen(&[]).is_empty());
    }
}
