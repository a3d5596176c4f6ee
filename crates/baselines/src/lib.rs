//! Two methods for the pose of a single car, written from their papers. The paper *Car Pose in Context* by Li et al.
//! compares its own method with both.
//!
//! Both methods solve one car at a time, with a calibrated camera and without a ground plane. Here both use this
//! project's shape atlas and keypoint scores, so a comparison shows only the difference between the methods. All
//! computations are in f64 and deterministic.
//!
//! # Contents
//! | function | files | paper |
//! |---|---|---|
//! | [`pavlakos`] | `pavlakos/`: relaxation, weak and full perspective | Pavlakos, Zhou, Chan, Derpanis, Daniilidis: 6-DoF Object Pose from Semantic Keypoints, ICRA 2017 |
//! | [`krishna_murthy`] | `krishna_murthy.rs`, `reprojection.rs` | Krishna Murthy, Krishna, Chhaya, Krishna: Reconstructing Vehicles from a Single Image, ICRA 2017 |

mod evidence;
mod krishna_murthy;
mod pavlakos;
mod reprojection;

use nalgebra::Isometry3;
use roadplane_base::Shape;

pub use krishna_murthy::krishna_murthy;
pub use pavlakos::{WeakPerspective, pavlakos, weak_perspective};

/// The estimated pose and shape of a car.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarFit {
    /// Rigid motion from the car's frame to the camera's frame.
    pub camera_from_car: Isometry3<f64>,
    /// Shape coefficients, each divided by its sd over all cars.
    pub shape: Shape,
}
