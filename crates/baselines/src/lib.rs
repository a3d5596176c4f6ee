//! The systems that the paper compares itself with, written from their papers: one car at a time, the camera known, nothing
//! known of the ground. Both get our shape atlas as their shape basis and our keypoints' scores as their confidences, so
//! that a table compares methods and nothing else. Pure maths in f64, deterministic.
//!
//! # Contents
//! | function | files | paper |
//! |---|---|---|
//! | [`pavlakos`] | `pavlakos/`: relaxation, weak, then full perspective | Pavlakos, Zhou, Chan, Derpanis, Daniilidis: 6-DoF Object Pose from Semantic Keypoints, ICRA 2017 |
//! | [`krishna_murthy`] | `krishna_murthy.rs`, `reprojection.rs` | Krishna Murthy, Krishna, Chhaya, Krishna: Reconstructing Vehicles from a Single Image, ICRA 2017 |

mod evidence;
mod krishna_murthy;
mod pavlakos;
mod reprojection;

use nalgebra::Isometry3;
use roadplane_base::Shape;

pub use krishna_murthy::krishna_murthy;
pub use pavlakos::{WeakPerspective, pavlakos, weak_perspective};

/// A car's pose and shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarFit {
    /// Rigid motion from the car's to the camera's frame.
    pub camera_from_car: Isometry3<f64>,
    /// Shape coefficients, each in units of its sd over all cars.
    pub shape: Shape,
}
