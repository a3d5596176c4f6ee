//! The rows of the table of activities: the input and the net of each row.

use std::path::PathBuf;

use roadplane_activity::{ActivityNet, Labelled, Motion};
use roadplane_base::median;

use super::video::VideoNet;
use crate::LabError;

/// The kind of motion that a row of the table has as input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seen {
    /// Motion of the box's middle in the picture.
    Picture,
    /// Motion of the box's middle in the picture, divided by the box's size.
    PictureBySize,
    /// Motion of the track on the ground.
    Ground,
}

/// A row of the table whose input is a motion.
pub(super) struct Row {
    pub name: &'static str,
    pub seen: Seen,
    pub net: ActivityNet,
}

/// The rows of the table of activities. In the table, the video row comes just before the last row of `motion`.
pub(super) struct Rows {
    pub motion: Vec<Row>,
    /// The net of the video row; `None` if the net's files are missing.
    pub video: Option<VideoNet>,
}

/// Name of the row whose input is pixels.
pub(super) const VIDEO: &str = "video";

/// Square root of the area of a typical car's box, m (`scripts/train/activity/data.py`).
///
/// The motion of the row *2D / size* is multiplied by this length. The net's input then has the magnitude of a motion
/// in metres.
const SIZE_M: f64 = 2.2;
/// Number of pixels that count as 1 m in the row *2D*, in a picture 1080 px high.
///
/// As with [`SIZE_M`], the net's input then has the magnitude of a motion in metres.
const PX_PER_M: f64 = 36.0;

/// Options of the evaluation of activities.
#[derive(Clone, Debug)]
pub struct ActivityOptions {
    /// Folder of the nets' files.
    pub models: PathBuf,
    /// Folder in which the runs of clips are kept and reused; `None` for a temporary folder.
    pub runs: Option<PathBuf>,
}

/// Returns the motion of the middles of a track's boxes in the picture, with y upwards.
///
/// The motion is scaled to about metres: by the boxes' size for [`Seen::PictureBySize`], otherwise by the picture's
/// height.
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

/// Predicts the activity labels of a motion with a net.
pub(super) fn predict(net: &mut ActivityNet, motion: &Motion) -> Result<Labelled, LabError> {
    Ok(net.label(motion).map_err(roadplane_pipeline::PipelineError::from)?)
}
