//! Analyses each frame before any vehicle is detected. It finds camera motion and changed parts of the picture, and it
//! collects a picture of the empty background.
//!
//! # Contents
//! ```text
//! RgbImage → SmallGrey      reduced grey copy; its longer side is at most 480 px           (small.rs)
//!          → Level          a picture of the place at one size; each block measures its shift     (level.rs)
//!          → Reference      a picture of the place at two sizes, for larger shifts            (reference.rs)
//!          → Alignment      shift, scale and rotation that fit the shifts of most blocks   (alignment.rs)
//!          → Panorama       pose of the picture on keyframes of the place      (registration.rs, panorama.rs)
//!          → Watcher        the verdict: at rest, moving, black, covered, …   (watcher.rs, position.rs, blind.rs)
//!          → View           how the picture shows its keyframe                                     (view.rs)
//! View     → ChangeMap      cells of the keyframe that changed since the detector inspected them (changes.rs)
//!          → Background     the keyframe without moving objects, at full size    (background.rs, mean_view.rs)
//! Background → BackgroundPicture   shows whether the camera was moved between two clips   (background_picture.rs)
//!            → SceneLine           straight edges that may be vertical                    (lines.rs, edges.rs)
//!            → SceneCurve          long edges that show the lens's distortion             (curves.rs)
//! ```
//!
//! All results depend only on the pictures and their times. Pictures that are older than a minute have hardly any
//! influence.

mod alignment;
mod background;
mod background_picture;
mod blind;
mod changes;
mod curves;
mod edges;
mod level;
mod lines;
mod mean_view;
mod panorama;
mod position;
mod reference;
mod registration;
mod search;
mod small;
mod view;
mod watcher;

pub use alignment::Alignment;
pub use background::{Background, EmptyScene};
pub use background_picture::{BackgroundPicture, Displacement};
pub use changes::{CELL_PX, Cells, ChangeMap};
pub use curves::scene_curves;
pub use lines::scene_lines;
pub use small::SmallGrey;
pub use view::View;
pub use watcher::{Observation, RENEW_S, Watcher};

/// The error of a failed OpenCV call. The cause is a bug or a lack of memory.
#[derive(Debug, thiserror::Error)]
#[error("OpenCV: {0}")]
pub struct WatchError(#[from] opencv::Error);
