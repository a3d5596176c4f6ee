//! Options of the solver.

use nalgebra::Matrix6;
use roadplane_base::{CameraParams, CameraPrior, Lens, SHARED_ERRORS, Shape, SharedSd};

use crate::linear::lm::LmOptions;
use crate::model::kernel::OutlierModel;

/// A Gaussian prior on a car's shape coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapePrior {
    /// Mean of the coefficients.
    pub mean: Shape,
    /// Inverse covariance; zero means that there is no prior.
    pub information: Matrix6<f64>,
    /// Whether the shape is fixed at the mean instead of estimated. Its uncertainty is then still a part of the
    /// covariance of the pose.
    pub fixed: bool,
}

impl Default for ShapePrior {
    /// Returns the prior of the car population: N(0, I).
    fn default() -> Self {
        Self { mean: Shape::zeros(), information: Matrix6::identity(), fixed: false }
    }
}

impl ShapePrior {
    /// Returns a prior that fixes the shape at the given coefficients. The information is that of all views of the car.
    #[must_use]
    pub fn fixed_at(shape: Shape, information: Matrix6<f64>) -> Self {
        Self { mean: shape, information, fixed: true }
    }
}

/// Switches for the optional steps of a solve; all steps are on by default.
///
/// `roadplane-lab eval solver --layers` measures the effect of each step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Steps {
    /// Rejects views that do not fit a car (`scene/rejection.rs`).
    pub rejection: bool,
    /// Tries the opposite class (inlier or outlier) for doubtful keypoints (`scene/reclassify.rs`).
    pub reclassify: bool,
    /// Refines the camera with all modes of the shape atlas (`scene/all_modes.rs`).
    ///
    /// `body_types` and `trust` are parts of this step. It is skipped if [`SceneOptions::atlas_residual_scale`] is 0.
    pub all_modes: bool,
    /// Uses the mixture of a car's likely body types as its shape prior (`model/latent/body_types.rs`).
    ///
    /// Solves with free poses (6 degrees of freedom) use this prior too.
    pub body_types: bool,
    /// Gives less weight to cars that fit worse than most cars of the frame (`model/latent/trust.rs`).
    pub trust: bool,
    /// Corrects the bias of the estimated camera (`problem/cars/bias.rs`).
    ///
    /// Without noise the bias is 0. With noise it is a fraction of the camera's sd.
    pub bias: bool,
}

impl Default for Steps {
    fn default() -> Self {
        Self { rejection: true, reclassify: true, all_modes: true, body_types: true, trust: true, bias: true }
    }
}

/// Correlations between the keypoint errors of a neural net (`problem/cars/joint.rs`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewErrors {
    /// Number of keypoints of a car that together count as one independent keypoint.
    ///
    /// It is 1 if the errors of a car's keypoints are independent.
    pub keypoints_as_one: f64,
    /// Mean error of the elevation from which cars appear to be seen, rad; positive: too steep.
    ///
    /// This is the mean for cars seen from the front or rear. For other cars, it is multiplied by cos² φ, where φ is
    /// the angle on the ground between the car's heading and the line of sight.
    pub mean_elevation: f64,
    /// Standard deviations of the errors that all cars of a scene share; [`SharedSd`] defines order and units.
    pub shared_sd: SharedSd,
}

/// Options for the solve of a scene or a car.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneOptions {
    /// Focal length given by the user, px.
    pub given_focal_px: Option<f64>,
    /// Camera at which the descent starts, such as the solution of the previous frame.
    ///
    /// If the cars do not fit this camera, the solver searches for other starts.
    pub start: Option<CameraParams>,
    /// Lens distortion, which the solver does not estimate.
    ///
    /// Its uncertainty is one of the errors that all cars share ([`ViewErrors::shared_sd`]).
    pub lens: Lens,
    /// Prior on the camera.
    pub camera_prior: CameraPrior,
    /// Number by which the sd of the shape atlas' residual is multiplied.
    ///
    /// The residual is the part of a keypoint's 3D position that the shape modes do not explain. With 0, the first 6
    /// modes describe every car exactly. The refinement with all modes is then skipped (`scene/all_modes.rs`).
    pub atlas_residual_scale: f64,
    /// Outlier model of keypoints.
    pub kernel: OutlierModel,
    /// Optional steps of the solve that are switched on.
    pub steps: Steps,
    /// Correlations of keypoint errors; `None` if the errors are independent, as those of synthetic noise are.
    pub view_errors: Option<ViewErrors>,
    /// Stopping rules of the descent.
    pub lm: LmOptions,
    /// Smallest share of inliers among a car's keypoints, 0–1. A car with a smaller share is rejected.
    pub min_inlier_share: f64,
    /// Largest cost of a car's fit, relative to its cost if all its keypoints were outliers.
    ///
    /// A car with a larger cost is rejected. Half of the keypoints of a false detection may fit, but not well and not
    /// with a likely shape.
    pub max_cost_share: f64,
    /// Smallest number of inliers among a car's keypoints. A car with fewer inliers is rejected.
    pub min_inliers: usize,
}

impl SceneOptions {
    /// Returns the number of keypoints of a car that count as one.
    pub(crate) fn keypoints_as_one(&self) -> f64 {
        self.view_errors.map_or(1.0, |errors| errors.keypoints_as_one)
    }

    /// Returns the standard deviations of the errors that all cars share; all 0 if the cars' errors are independent.
    #[must_use]
    pub fn shared_sd(&self) -> SharedSd {
        self.view_errors.map_or([0.0; SHARED_ERRORS], |errors| errors.shared_sd)
    }
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            given_focal_px: None,
            start: None,
            lens: Lens::STRAIGHT,
            camera_prior: CameraPrior::default(),
            atlas_residual_scale: 1.0,
            kernel: OutlierModel::default(),
            steps: Steps::default(),
            view_errors: None,
            lm: LmOptions::default(),
            min_inlier_share: 0.45,
            max_cost_share: 0.6,
            min_inliers: 6,
        }
    }
}
