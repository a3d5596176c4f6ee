//! Activities of vehicles against truth: the paper's Table 4 (*Car Pose in Context*, Activity Recognition).
//!
//! Each row is a net with its own input:
//! - *2D*, the paper's baseline: the motion of the box's middle in the picture.
//! - *2D / size*: that motion divided by the box's size.
//! - *3D*: the track on the ground.
//! - *3D from truth*: the true track.
//! - *Video*: the pixels around a vehicle over time; a small net, trained from scratch on rendered clips.
//!
//! All rows but *Video* have the same architecture and were trained on the same motions.

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

/// The rows: card of the net (in the models folder), name, and input.
const ROWS: [(&str, &str, Seen); 3] = [
    ("activity_2d.card.json", "2D", Seen::Picture),
    ("activity_2d_size.card.json", "2D / size", Seen::PictureBySize),
    ("activity.card.json", "3D", Seen::Ground),
];

/// The card of the net on pixels.
const VIDEO_CARD: &str = "activity_video.card.json";

/// Evaluates activities on a data set with truth or on a table of labelled tracks.
///
/// A data set is a folder with `dataset.json`; its clips are run, and every frame is scored. In a table each track is
/// one instance of one activity.
///
/// # Errors
/// [`LabError`] for files that cannot be read, nets that cannot be loaded, or a stop.
pub fn evaluate_activity(
    data: &Path,
    options: &ActivityOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let mut motion = Vec::new();
    for (card, name, seen) in ROWS {
        // Only this table uses the baselines, so a models folder may lack them.
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
