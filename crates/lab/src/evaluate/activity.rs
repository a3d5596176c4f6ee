//! Scores predicted activities of vehicles against truth: Table 4 of the paper *Car Pose in Context* (Activity
//! Recognition).
//!
//! Each row of the table is a net with its own input:
//! - *2D* (the paper's baseline): the motion of the box's middle in the picture.
//! - *2D / size*: the same motion divided by the box's size.
//! - *3D*: our track on the ground.
//! - *3D from truth*: the true track on the ground.
//! - *Video*: the pixels around a vehicle over time. The net is small and was trained from scratch on rendered clips.
//!
//! Except for *Video*, all nets have the same architecture and were trained on the same motions.

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

/// The rows whose input is a motion: file name of the net's card (in the models folder), name of the row, and input.
const ROWS: [(&str, &str, Seen); 3] = [
    ("activity_2d.card.json", "2D", Seen::Picture),
    ("activity_2d_size.card.json", "2D / size", Seen::PictureBySize),
    ("activity.card.json", "3D", Seen::Ground),
];

/// File name of the card of the net whose input is pixels.
const VIDEO_CARD: &str = "activity_video.card.json";

/// Evaluates activities on a data set with truth or on a table of labelled tracks.
///
/// A data set is a folder with `dataset.json`. The pipeline runs on its clips, and every frame is scored. In a table of
/// labelled tracks, each track is one instance of one activity.
///
/// # Errors
/// [`LabError`] if a file cannot be read, a net cannot be loaded, or the user stops the work.
pub fn evaluate_activity(
    data: &Path,
    options: &ActivityOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let mut motion = Vec::new();
    for (card, name, seen) in ROWS {
        // Only this table uses the baseline nets, so a models folder may lack them.
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
