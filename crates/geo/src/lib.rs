//! Positions of cameras and vehicles on the map.
//!
//! The user gives a [`Site`]: surveyed points in the picture, or the position and bearing of the camera. A [`Place`]
//! combines the site with the camera that a run estimated. It converts positions of vehicles to map coordinates.
//!
//! # Contents
//! - `site.rs`, `survey.rs`: the user's input.
//! - `solve.rs`: the camera and its position on the map, estimated together.
//! - `place.rs`: map positions of vehicles.
//! - `contradiction.rs`: points that contradict the camera, and the likely mistake.
//! - `utm.rs`: UTM coordinates.

#![deny(missing_docs)]

mod contradiction;
mod place;
mod site;
mod solve;
mod survey;
mod utm;

pub use contradiction::NotPlaced;
pub use place::{Fit, Place};
pub use site::Site;
pub use survey::{SurveyPoint, read_points};
pub use utm::UtmZone;
