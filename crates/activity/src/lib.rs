//! Tracks on the ground → what each vehicle does: a label with its probability for every sample, and events.
//!
//! # Contents
//! ```text
//! Motion (a track's samples)  → features   car-aligned motion, five times a second  (motion.rs, features.rs)
//!                             → net        bidirectional LSTM → probabilities       (net.rs)
//!                             → steady     one label a step, without flicker         (decode.rs, rules.rs)
//!                             → events     stretches of one label                    (events.rs), and starts and stops
//!                                          that are turns, too                       (spans.rs)
//! ```
//!
//! After Li et al., *Car Pose in Context*, §Activity Recognition: a bidirectional LSTM on ground-plane velocities. Here they are
//! resampled in time, turned into the car's frame where its heading is known, and told with how far they can be trusted, so that
//! neither the camera's place nor its frame rate matters. Training: `scripts/train/activity`.

mod decode;
mod events;
mod features;
mod label;
mod motion;
mod net;
mod rules;
mod spans;

pub use decode::Probabilities;
pub use events::{Event, Labelled};
pub use features::{FEATURES, features};
pub use label::{LABELS, Label};
pub use motion::{Motion, MotionError, STEP_S, grid};
pub use net::{ActivityError, ActivityNet};
pub use spans::{event_spans, stretch_spans};
