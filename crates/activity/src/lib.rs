//! Activities of vehicles: tracks on the ground → a label with its probability for every sample, and events.
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
//! After Li et al., *Car Pose in Context*, §Activity Recognition: a bidirectional LSTM on ground-plane velocities. Here
//! the velocities are resampled in time and turned into the car's frame where its heading is known. Their uncertainty
//! is an input too. Neither the position of the camera nor its frame rate matters. Training: `scripts/train/activity`.

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
