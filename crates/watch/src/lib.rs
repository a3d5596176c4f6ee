//! Watches the picture for camera motion, changes and the empty background, before any vehicle is detected.
//!
//! # Contents
//! ```text
//! RgbImage → SmallGrey      grey, halved until its longer side is at most 480 px               (small.rs)
//!          → Level          blocks of the background at one size: a shift and a gain for each  (level.rs)
//!          → Reference      the background at two sizes, for larger shifts                     (reference.rs)
//!          → Alignment      the one similarity that most blocks agree on                       (alignment.rs)
//!          → Watcher        the verdict: at rest, shaken, moved, cut, blind                    (watcher.rs, blind.rs)
//!          → ChangeMap      cells that changed since the detector last inspected them          (changes.rs)
//!          → Background     the scene without moving objects, at full size                     (background.rs)
//! Background → BackgroundPicture   was the camera moved since another clip         (background_picture.rs)
//!            → SceneLine           straight edges that may be vertical             (lines.rs, edges.rs)
//!            → SceneCurve          long edges that show the lens's distortion      (curves.rs)
//! ```
//!
//! All results follow from the pictures and their times. Only faded traces remain of pictures that are older than a
//! minute.

mod alignment;
mod background;
mod background_picture;
mod blind;
mod changes;
mod curves;
mod edges;
mod level;
mod lines;
mod reference;
mod search;
mod small;
mod watcher;

pub use alignment::Alignment;
pub use background::Background;
pub use background_picture::{BackgroundPicture, Displacement};
pub use changes::{CELL_PX, Cells, ChangeMap};
pub use curves::scene_curves;
pub use lines::scene_lines;
pub use small::SmallGrey;
pub use watcher::{Observation, RENEW_S, Watcher};

/// An OpenCV call failed: a bug, or no memory left.
#[derive(Debug, thiserror::Error)]
#[error("OpenCV: {0}")]
pub struct WatchError(#[from] opencv::Error);
