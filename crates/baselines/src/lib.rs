//! The systems that the paper compares itself with, written from their papers.
//!
//! They solve one car at a time, with a calibrated camera and without the ground. Both take our shape atlas as their
//! shape basis and our keypoints' scores as their confidences. So a table compares only the methods. Pure maths in f64,
//! deterministic.
//!
//! # Contents
//! | function | files | paper |
//! |---|---|---|
//! | [`pavlakos`] | `pavlakos/`: relaxation, weak and full perspective | Pavlakos, Zhou, Chan, Derpanis, Daniilidis:
//! 6-DoF Object Pose from Semantic Keypoints, ICRA 2017 |
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
    /// Rigid motion from the car's frame to the camera's frame.
    pub camera_from_car: Isometry3<f64>,
    /// Shape coefficients, each in units of its sd over all cars.
    pub shape: Shape,
}
