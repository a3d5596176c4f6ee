//! What vehicles do, against truth: the paper's Table 4 (*Car Pose in Context*, Activity Recognition).
//!
//! Rows: *2D*, the paper's baseline, sees the motion of the box's middle in the picture; *2D / size* the same divided by the
//! box's size; *3D* the track on the ground; *3D from truth* the true one. These are the same kind of net, trained on the same
//! motions. *Video* is a small net on the pixels around a vehicle over time, trained on rendered clips from nothing.

mod clips;
mod events;
mod instances;
mod rows;
mod scores;
mod truths;
mod video;
mod windows;

use std::path::Path;

use roadplane_pipeline::{Cancel, Config, Progress, open_activity};
use roadplane_tables::Report;

use crate::LabError;

pub use rows::ActivityOptions;

use rows::{Row, Rows, Seen};
use video::VideoNet;

/// Cards of the rows' nets, within the models folder, and names.
const ROWS: [(&str, &str, Seen); 3] = [
    ("activity_2d.card.json", "2D", Seen::Picture),
    ("activity_2d_size.card.json", "2D / size", Seen::PictureBySize),
    ("activity.card.json", "3D", Seen::Ground),
];

/// The card of the net on pixels.
const VIDEO_CARD: &str = "activity_video.card.json";

/// Evaluates on a data set with truth (a folder with `dataset.json`: its clips are run, everything is told per frame), or on a
/// table of labelled tracks, each one instance of one activity.
///
/// # Errors
/// [`LabError`] for files that cannot be read, nets that are refused, or a stop.
pub fn evaluate_activity(
    data: &Path,
    options: &ActivityOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let mut motion = Vec::new();
    for (card, name, seen) in ROWS {
        // The baselines serve nothing but this table; a models folder may come without them.
        if seen == Seen::Ground || options.models.join(card).is_file() {
            let mut config = config.clone();
            config.models.activity = card.into();
            motion.push(Row { name, seen, net: open_activity(&options.models, &config)? });
        } else {
            tracing::warn!("the row {name} is left out: {card} is not in the models folder");
        }
    }
    if !data.is_dir() {
        return instances::evaluate(data, &mut motion, cancel, progress);
    }
    let video = options.models.join(VIDEO_CARD);
    let video = if video.is_file() { Some(VideoNet::open(&video)?) } else { None };
    clips::evaluate(data, &mut Rows { motion, video }, options, config, cancel, progress)
}
