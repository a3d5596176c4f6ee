//! What vehicles do, against truth: the paper's Table 4 (*Car Pose in Context*, Activity Recognition).
//!
//! Rows: *2D*, the paper's baseline, sees the motion of the box's middle in the picture; *2D / size* the same divided by the
//! box's size; *3D* the track on the ground; *3D from truth* the true one. All are the same kind of net, trained on the same
//! motions. The paper's video row would need video nets and is not here.

mod clips;
mod events;
mod instances;
mod scores;
mod truths;

use std::path::{Path, PathBuf};

use roadplane_activity::{ActivityNet, Labelled, Motion};
use roadplane_pipeline::{Cancel, Config, Progress, open_activity};

use crate::EvalError;
use roadplane_tables::Report;

/// How a row of the table sees motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seen {
    Picture,
    PictureBySize,
    Ground,
}

/// Cards of the rows' nets, within the models folder, and names.
const ROWS: [(&str, &str, Seen); 3] = [
    ("activity_2d.card.json", "2D", Seen::Picture),
    ("activity_2d_size.card.json", "2D / size", Seen::PictureBySize),
    ("activity.card.json", "3D", Seen::Ground),
];

/// A row of the table.
struct Row {
    name: &'static str,
    seen: Seen,
    net: ActivityNet,
}

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

/// Evaluates on a data set with truth (a folder with `dataset.json`: its clips are run, everything is told per frame), or on a
/// table of labelled tracks, each one instance of one activity.
///
/// # Errors
/// [`EvalError`] for files that cannot be read, nets that are refused, or a stop.
pub fn evaluate_activity(
    data: &Path,
    options: &ActivityOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, EvalError> {
    let mut rows = Vec::new();
    for (card, name, seen) in ROWS {
        // The baselines serve nothing but this table; a models folder may come without them.
        if seen == Seen::Ground || options.models.join(card).is_file() {
            let mut config = config.clone();
            config.models.activity = card.into();
            rows.push(Row { name, seen, net: open_activity(&options.models, &config)? });
        } else {
            tracing::warn!("the row {name} is left out: {card} is not in the models folder");
        }
    }
    if data.is_dir() {
        clips::evaluate(data, &mut rows, options, config, cancel, progress)
    } else {
        instances::evaluate(data, &mut rows, cancel, progress)
    }
}

/// The motion of boxes' middles in the picture (y up): in px, or divided by the boxes' size.
fn picture_motion(time_s: &[f64], boxes_px: &[[f64; 4]], picture_height_px: f64, seen: Seen) -> Motion {
    let mut sizes: Vec<f64> =
        boxes_px.iter().map(|[x0, y0, x1, y1]| ((x1 - x0) * (y1 - y0)).max(1.0).sqrt()).collect();
    sizes.sort_by(f64::total_cmp);
    let median = sizes.get(sizes.len() / 2).copied().unwrap_or(1.0);
    let scale =
        if seen == Seen::PictureBySize { SIZE_M / median } else { 1080.0 / picture_height_px / PX_PER_M };
    let middle = |[x0, y0, x1, y1]: &[f64; 4]| [scale * (x0 + x1) / 2.0, -scale * (y0 + y1) / 2.0];
    Motion { time_s: time_s.to_vec(), xy_m: boxes_px.iter().map(middle).collect(), ..Motion::default() }
}

/// What a net tells of a motion.
fn told(net: &mut ActivityNet, motion: &Motion) -> Result<Labelled, EvalError> {
    Ok(net.label(motion).map_err(roadplane_pipeline::PipelineError::from)?)
}
