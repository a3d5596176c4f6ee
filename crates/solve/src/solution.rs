//! What goes in besides options, and what comes out.

use nalgebra::{Isometry3, Matrix3, Matrix4, Matrix6};
use roadplane_base::{CameraParams, GroundPose, JointInformation, KEYPOINTS, KeypointSet, Shape};

use crate::linear::lm::Termination;

/// One car in one frame.
#[derive(Clone, Copy, Debug)]
pub struct CarView<'a> {
    /// What was found of it.
    pub keypoints: &'a KeypointSet,
    /// Views of the same group are the same physical car: one shape.
    pub group: usize,
    /// How much of an independent observation this view is, 0–1.
    pub weight: f64,
}

impl<'a> CarView<'a> {
    /// Views of as many different cars, in this order, each of full weight.
    pub fn each(cars: impl IntoIterator<Item = &'a KeypointSet>) -> Vec<Self> {
        let view = |(group, keypoints)| Self { keypoints, group, weight: 1.0 };
        cars.into_iter().enumerate().map(view).collect()
    }
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneStatus {
    /// Focal length and plane come from the cars.
    Converged,
    /// Focal length was given; the plane comes from the cars.
    FocalGiven,
    /// The cars say too little about the focal length: it rests on the prior and is as uncertain as that.
    FocalFromPrior,
    /// The loop ran out of iterations before it came near the minimum.
    NotConverged,
    /// No car could be used; the numbers are the prior.
    TooFewCars,
    /// Nothing could be evaluated (no finite input, impossible geometry); the numbers are the prior.
    Failed,
}

impl SceneStatus {
    /// Of a solve that stopped so, its focal length given, or told by the cars.
    pub(crate) fn of(termination: Termination, is_given: bool, is_determined: bool) -> Self {
        match (termination.converged(), is_given, is_determined) {
            (false, ..) => Self::NotConverged,
            (_, true, _) => Self::FocalGiven,
            (.., true) => Self::Converged,
            (.., false) => Self::FocalFromPrior,
        }
    }

    /// Whether camera and cars can be used (with their covariances).
    #[must_use]
    pub fn usable(self) -> bool {
        matches!(self, Self::Converged | Self::FocalGiven | Self::FocalFromPrior)
    }
}

/// One car's part of the answer.
#[derive(Clone, Debug)]
pub struct CarSolution {
    /// Rigid motion from the car's to the camera's frame.
    pub camera_from_car: Isometry3<f64>,
    /// Where it stands in the world frame.
    pub ground: GroundPose,
    /// Covariance of (x m, y m, heading rad): with the camera's uncertainty where that is estimated, too
    /// ([`solve_scene`](crate::solve_scene)), without where it is given ([`fit_car`](crate::fit_car)).
    pub ground_covariance: Matrix3<f64>,
    /// Shape coefficients, each in units of its sd over all cars.
    pub shape: Shape,
    /// Their covariance.
    pub shape_covariance: Matrix6<f64>,
    /// Keypoints that are more likely right than wrong.
    pub inliers: [bool; KEYPOINTS],
    /// Root mean square distance of the inliers from their projections, px.
    pub reprojection_rms_px: f64,
    /// Whether the car took part in the estimate.
    pub used: bool,
}

/// A frame's answer.
#[derive(Clone, Debug)]
pub struct SceneSolution {
    /// How it ended.
    pub status: SceneStatus,
    /// Focal length, tilt, roll, height.
    pub params: CameraParams,
    /// What the cars alone say of (log f, tilt, roll, log h) and of the errors they share, poses and shapes marginalised: what may
    /// be added up over independent frames of a place. Prior and factors are not in it.
    pub information: JointInformation,
    /// Covariance of (log f, tilt, roll, log h), prior, factors and shared errors counted; zero where given.
    pub covariance: Matrix4<f64>,
    /// Per view, in the order given; `None` where nothing could be fitted.
    pub cars: Vec<Option<CarSolution>>,
    /// Cost at the end (negative log posterior up to a constant).
    pub cost: f64,
    /// Linearisations of the final refinement.
    pub iterations: usize,
    /// Why the final refinement stopped.
    pub termination: Termination,
}
