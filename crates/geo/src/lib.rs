//! Where a camera stands on the map, and with it every vehicle.
//!
//! A [`Site`] is what people know: surveyed points in the picture, or where the camera stands and looks. Together with the
//! camera that vehicles gave it makes a [`Place`].
//!
//! # Contents
//! `site.rs`, `survey.rs` what people know; `solve.rs` camera and place together; `place.rs` what follows for cars; `utm.rs`.

#![deny(missing_docs)]

mod place;
mod site;
mod solve;
mod survey;
mod utm;

pub use place::{Fit, Place};
pub use site::Site;
pub use survey::{SurveyPoint, read_points};
pub use utm::UtmZone;
