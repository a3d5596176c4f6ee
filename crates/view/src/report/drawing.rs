//! The part of the report in which a user draws gates, zones, lengths and surveyed points on a frame, and saves them as
//! files. The scripts `drawing*.js` do all the work in the browser.
//!
//! If the browser runs no scripts, the part is hidden.

use serde::Serialize;

use super::input::ReportInput;
use super::pictures::data_uri_up_to;
use crate::ViewError;

/// Largest width of a frame to draw on, px. A larger frame is reduced to this width. The files keep its full size.
const MAX_WIDTH: u32 = 1920;
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
    let still = |plain: &super::PlainFrame<'_>| {
        Ok(Still {
            frame: plain.frame,
            time: (plain.time_s * 1e3).round() / 1e3,
            segment: plain.segment,
            picture: data_uri_up_to(plain.picture, MAX_WIDTH)?,
        })
    };
    let data = Data {
        size: first.picture.dimensions().into(),
        moving: input.still_motion.iter().any(Option::is_some),
        stills: input.frames.iter().map(still).collect::<Result<_, ViewError>>()?,
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
