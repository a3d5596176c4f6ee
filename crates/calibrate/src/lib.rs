//! Estimates the focal length and the ground plane over time from the evidence of all frames of a clip.
//!
//! The crate is pure maths on records: it has no I/O, no clock, no random numbers and no panics. The order of the cars
//! in a frame does not matter.
//!
//! # Data flow
//! ```text
//! FrameRecord → PlacesBuilder → Places             where the reference pictures of a moving camera lie
//!             → OneCamera                         converts boxes and keypoints to those of one camera
//!             → EvidenceBuilder ── Linker          assigns boxes to cars
//!                               └─ ViewSelector    takes one view of a parked car, several of a moving one
//!             → Window { views, … } → (joint solve of the window, in another crate) → WindowEstimate
//!             → fuse → one CameraEstimate per camera position
//! GroundView → GroundEvidence → Fold → Window::divided    two planes, where the slope of the road changes
//! SceneLine → cues → Factor → fuse                focal length from vertical lines
//! Registration → PlacesBuilder → Turns → cues → Factor → fuse   focal length from turns and zooms
//! user constraints → Factor → fuse
//! SceneCurve, Registration → TurnedLensBuilder → LensView   lens distortion and its sd, before any solve
//! CameraEvidence of other clips → epochs → more WindowEstimates for fuse    camera database
//! ```
//!
//! # Calibrated uncertainties
//! A parked car that appears in 100 frames is one car. The white noise of its keypoints averages out, but their bias
//! does not ([`combine`]). A car that appears in ten windows counts once ([`fuse`]).

mod adjust;
mod combine;
mod cues;
mod epochs;
mod evidence;
mod factors;
mod fuse;
mod ground;
mod lens;
mod linker;
mod one_camera;
mod places;
mod select;
mod turned_camera;
mod turned_lens;
mod turns;
mod verticals;
mod view;

/// Largest number of rounds of an iteration that ends where nothing changes.
const MOST_ROUNDS: usize = 200;
/// Squared distance, in sds, beyond which an error does not explain a difference. For the four numbers of a clip and an
/// epoch of its camera, this happens once in 2·10⁵ by chance.
const CONTRADICTS: f64 = 30.0;

pub use combine::combine;
pub use cues::{SceneView, cues};
pub use epochs::{Epoch, SameView, epochs, joins, same_vehicle};
pub use evidence::{EvidenceBuilder, Window};
pub use factors::{Factor, Length, Survey, VerticalVanishingPoint, derivatives_by_camera};
pub use fuse::{CarIdentity, CarUse, FuseOptions, Joined, LEAST_SD, WindowEstimate, condense, fuse, join};
pub use ground::{Fold, GroundEvidence, GroundView};
pub use lens::{LensView, LogFocal, STRAIGHT_SD};
pub use linker::{LinkId, Linker};
pub use one_camera::OneCamera;
pub use places::{Places, PlacesBuilder};
pub use select::ViewSelector;
pub use turned_camera::turned_information;
pub use turned_lens::{TurnedLens, TurnedLensBuilder};
pub use turns::Turns;
pub use verticals::{Verticals, verticals};
pub use view::View;
