//! Input and output of a solve.

use nalgebra::{Isometry3, Matrix3, Matrix4, Matrix6, Vector3};
use roadplane_base::{CameraParams, GroundPose, JointInformation, KEYPOINTS, KeypointSet, Shape};

use crate::linear::lm::Termination;

/// One view of a car: its keypoints in one frame.
#[derive(Clone, Copy, Debug)]
pub struct CarView<'a> {
    /// Keypoints of the car in the image.
    pub keypoints: &'a KeypointSet,
    /// Number of the physical car. Views with the same number share one shape.
    pub group: usize,
    /// Weight of the view, 0–1; 1 if it is independent of all other views.
    pub weight: f64,
}

impl<'a> CarView<'a> {
    /// Returns one view per keypoint set, with weight 1 and a different group for each.
    pub fn each(cars: impl IntoIterator<Item = &'a KeypointSet>) -> Vec<Self> {
        let view = |(group, keypoints)| Self { keypoints, group, weight: 1.0 };
        cars.into_iter().enumerate().map(view).collect()
    }
}

/// Outcome of a solve: how the focal length was determined, or why the solve failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneStatus {
    /// Focal length and plane come from the cars.
    Converged,
    /// The caller gave the focal length, and the plane comes from the cars.
    FocalGiven,
    /// The cars do not determine the focal length. Its value and its uncertainty come from the prior.
    FocalFromPrior,
    /// The descent used up its iterations before it came near the minimum.
    NotConverged,
    /// No car could be used. Camera and covariance are those of the prior.
    TooFewCars,
    /// The cost could not be evaluated: no finite input, or impossible geometry. Camera and covariance are those of the
    /// prior.
    Failed,
}

impl SceneStatus {
    /// Returns the status of a solve that stopped for this reason.
    ///
    /// `is_given` means that the caller gave the focal length, `is_determined` that the cars determine it.
    pub(crate) fn of(termination: Termination, is_given: bool, is_determined: bool) -> Self {
        match (termination.converged(), is_given, is_determined) {
            (false, ..) => Self::NotConverged,
            (_, true, _) => Self::FocalGiven,
            (.., true) => Self::Converged,
            (.., false) => Self::FocalFromPrior,
        }
    }

    /// Whether the estimated camera and cars, with their covariances, can be used.
    #[must_use]
    pub fn usable(self) -> bool {
        matches!(self, Self::Converged | Self::FocalGiven | Self::FocalFromPrior)
    }
}

/// Solution of one car.
#[derive(Clone, Debug)]
pub struct CarSolution {
    /// Rigid transform from the car frame to the camera frame, m.
    pub camera_from_car: Isometry3<f64>,
    /// Position and heading on the ground plane, in the world frame.
    pub ground: GroundPose,
    /// Covariance of the ground pose (x m, y m, heading rad).
    ///
    /// From [`solve_scene`](crate::solve_scene), it includes the uncertainty of the estimated camera. From
    /// [`fit_car`](crate::fit_car), it treats the given camera as exact.
    pub ground_covariance: Matrix3<f64>,
    /// Shape coefficients. Each is in units of the coefficient's standard deviation over all cars.
    pub shape: Shape,
    /// Covariance of the shape coefficients.
    pub shape_covariance: Matrix6<f64>,
    /// Whether each keypoint is an inlier: more likely right than wrong.
    pub inliers: [bool; KEYPOINTS],
    /// Root mean square distance between the inliers and the projected keypoints of the fitted car, px.
    pub reprojection_rms_px: f64,
    /// Whether the car contributed to the estimate of the camera; `false` if it was rejected.
    pub used: bool,
}

/// Evidence of the keypoints of one view on (tilt, roll, log height) of the plane below its car.
///
/// The cost is quadratic near the solution: `gradientᵀ d + ½ dᵀ information d` for the change d of the three numbers.
/// The pose is eliminated. Focal length and shape are those of the solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneEvidence {
    /// Hessian of the cost.
    pub information: Matrix3<f64>,
    /// Gradient of the cost at the plane of the solution.
    pub gradient: Vector3<f64>,
}

/// Solution of a frame.
#[derive(Clone, Debug)]
pub struct SceneSolution {
    /// Outcome of the solve.
    pub status: SceneStatus,
    /// Estimated focal length, tilt, roll and height of the camera.
    pub params: CameraParams,
    /// Information of the cars alone on the camera (log f, tilt, roll, log h) and on the errors that all cars share.
    ///
    /// Poses and shapes of the cars are marginalised. The camera's prior is not included. So the information of
    /// independent frames of a scene can be summed.
    pub information: JointInformation,
    /// Covariance of (log f, tilt, roll, log h).
    ///
    /// It includes the camera's prior and the errors that all cars share. Rows of given parameters are zero.
    pub covariance: Matrix4<f64>,
    /// Solution of the car in each view, in the order of the input; `None` if the view could not be fitted.
    pub cars: Vec<Option<CarSolution>>,
    /// Evidence of each view on the plane below its car; `None` if the view had no part in the solution.
    pub plane_evidence: Vec<Option<PlaneEvidence>>,
    /// Cost at the minimum: the negative log posterior up to a constant.
    pub cost: f64,
    /// Number of linearisations in the final descent.
    pub iterations: usize,
    /// Reason why the final descent stopped.
    pub termination: Termination,
}

impl SceneSolution {
    /// Returns the camera (log f, tilt, roll, log h) of the cars alone, and their information with this mean.
    ///
    /// The camera's prior is removed. If this moves the camera by more than 2 sds, the linearisation does not hold, and
    /// the camera of the solution is returned.
    #[must_use]
    pub fn by_cars(&self) -> (CameraParams, JointInformation) {
        let joint = self.information;
        let alone = joint.information.cholesky().map(|i| CameraParams::from_vector(&i.solve(&joint.vector)));
        let params = alone.filter(|alone| self.is_near(alone)).unwrap_or(self.params);
        (params, JointInformation { vector: joint.information * params.to_vector(), ..joint })
    }

    /// Whether a camera is within 2 sds of the solution.
    fn is_near(&self, params: &CameraParams) -> bool {
        let step = params.to_vector() - self.params.to_vector();
        let sd = self.covariance.diagonal().map(|variance| variance.max(0.0).sqrt());
        (0..4).all(|i| step[i].is_finite() && step[i].abs() <= 2.0 * sd[i] + 1e-9)
    }
}
