//! Evidence of all frames of a clip → focal length and ground plane over time. Pure maths on records: no I/O, no clock, no
//! random numbers, no panics; the order of the cars in a frame does not matter.
//!
//! # How the pieces join
//! ```text
//! FrameRecord → AtRest                            shake taken out, moves put where they happened
//!             → EvidenceBuilder ── Linker          which box is which car
//!                               ├─ MoveDetector    did the camera move, where no picture tells
//!                               └─ ViewSelector    one view a parked car, several of a moving one
//!             → Window { views, … } → (joint solve of the window, elsewhere) → WindowEstimate
//!             → fuse → CameraEstimate per stretch of time
//! SceneLine → verticals → Factor, and beside_a_witness(windows) → more for fuse      what the scene says of the focal length
//! CarHeading → parallel → Factor                                                    what parallel cars say of it
//! SceneCurve → LensView → how the lens bends lines, and how well that is known             before anything is solved
//! CameraEvidence of other clips → epochs → more WindowEstimates for fuse      what is remembered of the camera
//! ```
//!
//! # Honest uncertainty
//! A parked car seen in 100 frames is one car: its keypoints' white noise averages out, their bias does not
//! ([`combine`]); seen in ten windows it counts once ([`fuse`]).

mod at_rest;
mod combine;
mod evidence;
mod fuse;
mod lens;
mod linker;
mod moves;
mod nodes;
mod parallel;
mod prior;
mod remember;
mod select;
mod stretch;
mod verticals;
mod witness;

pub use at_rest::AtRest;
pub use combine::{Combined, combine};
pub use evidence::{EvidenceBuilder, EvidenceOptions, Window};
pub use fuse::{CarUse, FuseOptions, Joined, WindowEstimate, condense, fuse, join};
pub use lens::{LensFound, LensView, LogFocal};
pub use linker::{LinkId, Linker, LinkerOptions};
pub use moves::{MoveDetector, MoveOptions, MoveState, SegmentStart};
pub use parallel::{CarHeading, Parallel, parallel};
pub use prior::FusePrior;
pub use remember::{Epoch, SameView, epochs, joins, same_vehicle};
pub use select::{SelectOptions, View, ViewSelector};
pub use verticals::{Verticals, verticals};
pub use witness::beside_a_witness;
