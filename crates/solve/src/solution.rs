//! Input and output of a solve.

use nalgebra::{Isometry3, Matrix3, Matrix4, Matrix6};
use roadplane_base::{CameraParams, GroundPose, JointInformation, KEYPOINTS, KeypointSet, Shape};

use crate::linear::lm::Termination;

/// One view of a car: its keypoints in one frame.
#[derive(Clone, Copy, Debug)]
pub struct CarView<'a> {
    /// Located keypoints.
    pub keypoints: &'a KeypointSet,
    /// Number of the physical car; views of the same group share one shape.
    pub group: usize,
    /// Weight relative to an independent observation, 0–1.
    pub weight: f64,
}

impl<'a> CarView<'a> {
    /// Returns one view of full weight per car, all of different cars.
    pub fn each(cars: impl IntoIterator<Item = &'a KeypointSet>) -> Vec<Self> {
        let view = |(group, keypoints)| Self { keypoints, group, weight: 1.0 };
        cars.into_iter().enumerate().map(view).collect()
    }
}

/// Result of a solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneStatus {
    /// Focal length and plane come from the cars.
    Converged,
    /// Focal length was given; the plane comes from the cars.
    FocalGiven,
    /// The cars do not determine the focal length: it rests on the prior and is as uncertain as the prior.
    FocalFromPrior,
    /// The loop reached its largest number of iterations before it came near the minimum.
    NotConverged,
    /// No car could be used; the numbers are the prior.
    TooFewCars,
    /// Nothing could be evaluated (no finite input, impossible geometry); the numbers are the prior.
    Failed,
}

impl SceneStatus {
    /// Returns the status of a solve; its focal length may be given, or determined by the cars.
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

/// Solution of one car.
#[derive(Clone, Debug)]
pub struct CarSolution {
    /// Rigid motion from the car's to the camera's frame, m.
    pub camera_from_car: Isometry3<f64>,
    /// Pose on the ground, world frame.
    pub ground: GroundPose,
    /// Covariance of (x m, y m, heading rad).
    ///
    /// It includes the camera's uncertainty if the camera is estimated ([`solve_scene`](crate::solve_scene)), but not
    /// if the camera is given ([`fit_car`](crate::fit_car)).
    pub ground_covariance: Matrix3<f64>,
    /// Shape coefficients, each in units of its sd over all cars.
    pub shape: Shape,
    /// Covariance of the shape coefficients.
    pub shape_covariance: Matrix6<f64>,
    /// Keypoints that are more likely right than wrong.
    pub inliers: [bool; KEYPOINTS],
    /// Root mean square distance of the inliers from their projections, px.
    pub reprojection_rms_px: f64,
    /// Whether the car took part in the estimate.
    pub used: bool,
}

/// Solution of a frame.
#[derive(Clone, Debug)]
pub struct SceneSolution {
    /// Result of the solve.
    pub status: SceneStatus,
    /// Focal length, tilt, roll and height.
    pub params: CameraParams,
    /// Information of the cars alone on (log f, tilt, roll, log h) and on the errors they share.
    ///
    /// Poses and shapes are marginalised. Prior and factors are not included. So the information of independent frames
    /// of a scene can be summed.
    pub information: JointInformation,
    /// Covariance of (log f, tilt, roll, log h), with prior, factors and shared errors; zero for given parameters.
    pub covariance: Matrix4<f64>,
    /// Solution per view, in the order of the input; `None` if a view could not be fitted.
    pub cars: Vec<Option<CarSolution>>,
    /// Cost at the minimum: the negative log posterior up to a constant.
    pub cost: f64,
    /// Number of linearisations of the final refinement.
    pub iterations: usize,
    /// Reason why the final refinement stopped.
    pub termination: Termination,
}
