//! Recognises the activities of vehicles from their tracks on the ground. Each sample of a track gets a label with its
//! probability, and each track gets a list of events.
//!
//! # Contents
//! ```text
//! Motion (a track's samples)  → features   car-aligned motion, five times a second  (motion.rs, features.rs)
//!                             → net        bidirectional LSTM → probabilities       (net.rs, probabilities.rs)
//!                             → steady     one label per step, without flicker      (decode.rs, rules.rs)
//!                             → events     intervals of one label                   (events.rs), and starts and stops
//!                                          within turns                             (spans.rs)
//! ```
//!
//! The method follows Li et al., *Car Pose in Context*, §Activity Recognition: a bidirectional LSTM whose input is
//! velocities on the ground plane. Here the velocities are resampled in time. Where the heading of a car is known, the
//! velocities are rotated into the car's frame. The uncertainty of the velocities is an input too. The results do not
//! depend on the camera's position or frame rate. The scripts in `scripts/train/activity` train the net.

mod decode;
mod events;
mod features;
mod label;
mod motion;
mod net;
mod probabilities;
mod rules;
mod spans;

pub use events::{Event, Labelled};
pub use features::{FEATURES, features};
pub use label::{LABELS, Label};
pub use motion::{Motion, MotionError, STEP_S, grid};
pub use net::{ActivityError, ActivityNet};
pub use probabilities::Probabilities;
pub use spans::{event_spans, label_spans};
