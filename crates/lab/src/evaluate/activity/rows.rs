//! The rows of the table: what each sees, and its net.

use std::path::PathBuf;

use roadplane_activity::{ActivityNet, Labelled, Motion};
use roadplane_base::median;

use super::video::VideoNet;
use crate::LabError;

/// How a row of the table sees motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seen {
    Picture,
    PictureBySize,
    Ground,
}

/// A row of the table that sees motion.
pub(super) struct Row {
    pub name: &'static str,
    pub seen: Seen,
    pub net: ActivityNet,
}

/// The rows of the table, as they stand in it: the video before the last, which is ours.
pub(super) struct Rows {
    pub motion: Vec<Row>,
    /// None without its net.
    pub video: Option<VideoNet>,
}

/// Name of the row on pixels.
pub(super) const VIDEO: &str = "video";

/// Square root of the area that a car's box has, m, and how many px of a picture 1080 px high stand for 1 m in the row 2D:
/// so that the nets see numbers of the order of metres (`scripts/train/activity/data.py`).
const SIZE_M: f64 = 2.2;
/// See [`SIZE_M`].
const PX_PER_M: f64 = 36.0;

/// What is asked for.
#[derive(Clone, Debug)]
pub struct ActivityOptions {
    /// Folder of the models.
    pub models: PathBuf,
    /// Where runs of clips stay, and finished ones are used again; `None` for a folder that is removed.
    pub runs: Option<PathBuf>,
}

/// The motion of boxes' middles in the picture (y up): in px, or divided by the boxes' size.
pub(super) fn picture_motion(
    time_s: &[f64],
    boxes_px: &[[f64; 4]],
    picture_height_px: f64,
    seen: Seen,
) -> Motion {
    let size_px = |[x0, y0, x1, y1]: &[f64; 4]| ((x1 - x0) * (y1 - y0)).max(1.0).sqrt();
    let scale = if seen == Seen::PictureBySize {
        SIZE_M / median(&mut boxes_px.iter().map(size_px).collect::<Vec<_>>()).unwrap_or(1.0)
    } else {
        1080.0 / picture_height_px / PX_PER_M
    };
    let middle = |[x0, y0, x1, y1]: &[f64; 4]| [scale * (x0 + x1) / 2.0, -scale * (y0 + y1) / 2.0];
    Motion { time_s: time_s.to_vec(), xy_m: boxes_px.iter().map(middle).collect(), ..Motion::default() }
}

/// What a net tells of a motion.
pub(super) fn told(net: &mut ActivityNet, motion: &Motion) -> Result<Labelled, LabError> {
    Ok(net.label(motion).map_err(roadplane_pipeline::PipelineError::from)?)
}
