//! What the pictures themselves say, before any vehicle is looked for: whether the camera is at rest, what changed, and how the
//! empty place looks.
//!
//! # Contents
//! ```text
//! RgbImage → SmallGrey      grey, halved until its longer side is at most 480 px                  (small.rs)
//!          → Level          the background's blocks at one size; each tells a shift and a gain     (level.rs)
//!          → Reference      the background at two sizes, for larger shifts                        (reference.rs)
//!          → Alignment      one similarity that most blocks agree on                              (alignment.rs)
//!          → Watcher        rest, shake, move, cut, nothing to see; the new position since when   (watcher.rs, blind.rs)
//!          → ChangeMap      cells that are not as they were when the detector last looked there   (changes.rs)
//!          → Background     the place without what moves, full size                               (background.rs)
//! Background → PlacePicture   was the camera moved since another clip                             (place.rs)
//!            → SceneLine      straight edges that may be vertical                                 (lines.rs, edges.rs)
//!            → SceneCurve     long edges that show how the lens bends lines                      (curves.rs)
//! ```
//!
//! Everything follows from the pictures and their times. Of what was longer ago than a minute nothing but faded traces is
//! left.

mod alignment;
mod background;
mod blind;
mod changes;
mod curves;
mod edges;
mod level;
mod lines;
mod place;
mod reference;
mod search;
mod small;
mod watcher;

pub use alignment::Alignment;
pub use background::Background;
pub use changes::{CELL_PX, Cells, ChangeMap};
pub use curves::scene_curves;
pub use lines::scene_lines;
pub use place::{Displacement, PlacePicture};
pub use small::SmallGrey;
pub use watcher::{RENEW_S, Seen, Watcher};

/// A picture that OpenCV cannot work on: a bug, or no memory left.
#[derive(Debug, thiserror::Error)]
#[error("OpenCV: {0}")]
pub struct WatchError(#[from] opencv::Error);
