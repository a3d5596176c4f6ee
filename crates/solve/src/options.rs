//! Options of the solver.

use std::sync::Arc;

use nalgebra::Matrix6;
use roadplane_base::{CameraParams, CameraPrior, Factor, Lens, SHARED_ERRORS, Shape, SharedSd};

use crate::linear::lm::LmOptions;
use crate::model::kernel::OutlierModel;

/// A Gaussian prior on a car's shape coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapePrior {
    /// Mean of the coefficients.
    pub mean: Shape,
    /// Inverse covariance; zero without a prior.
    pub information: Matrix6<f64>,
    /// Whether the shape is fixed at the mean.
    pub fixed: bool,
}

impl Default for ShapePrior {
    /// Returns the prior of the car population: N(0, I).
    fn default() -> Self {
        Self { mean: Shape::zeros(), information: Matrix6::identity(), fixed: false }
    }
}

impl ShapePrior {
    /// Returns a prior that fixes the shape at the given one.
    #[must_use]
    pub fn fixed_at(shape: Shape) -> Self {
        Self { mean: shape, information: Matrix6::identity(), fixed: true }
    }
}

/// Steps of a solve that can be switched off; all are on by default.
///
/// `roadplane-lab eval solver --layers` measures the effect of each step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Steps {
    /// Rejects views that do not fit a car (`scene/rejection.rs`).
    pub rejection: bool,
    /// Tries the opposite decision for single keypoints: wrong or right (`scene/reclassify.rs`).
    pub reclassify: bool,
    /// Refines the camera with all modes of the atlas (`scene/all_modes.rs`); `body_types` and `trust` are parts of
    /// this step.
    ///
    /// The step is left out if [`SceneOptions::atlas_residual_scale`] is 0.
    pub all_modes: bool,
    /// Uses the mixture of a car's likely body types as its prior (`model/latent/body_types.rs`), also for free cars.
    pub body_types: bool,
    /// Gives cars that fit worse than others less weight (`model/latent/trust.rs`).
    pub trust: bool,
    /// Corrects the bias of the minimum (`problem/cars/bias.rs`): 0 without noise, a fraction of a sd with noise.
    pub bias: bool,
}

impl Default for Steps {
    fn default() -> Self {
        Self { rejection: true, reclassify: true, all_modes: true, body_types: true, trust: true, bias: true }
    }
}

/// Correlations of keypoint errors, as nets make them (`problem/cars/joint.rs`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewErrors {
    /// Number of keypoints of a car that count as one independent keypoint; 1 if their errors are independent.
    pub keypoints_as_one: f64,
    /// sds of the errors that all cars of a scene share, in the order of [`SharedSd`].
    pub shared_sd: SharedSd,
}

/// Options for the solve of a scene or a car.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneOptions {
    /// Focal length given by the user, px.
    pub given_focal_px: Option<f64>,
    /// Start of the descent, such as the solution of the previous frame. The solver searches if the cars do not fit
    /// there.
    pub start: Option<CameraParams>,
    /// Lens distortion. Its uncertainty counts as an error that all cars share ([`ViewErrors::shared_sd`]).
    pub lens: Lens,
    /// Prior on the camera.
    pub camera_prior: CameraPrior,
    /// Factors on the camera beside the cars.
    ///
    /// They count in the estimate and its covariance, but not in [`SceneSolution::information`](crate::SceneSolution).
    pub factors: Arc<[Factor]>,
    /// Factor on the residual sd of the atlas' first modes.
    ///
    /// With 0, cars are exactly in the atlas, and the steps with all modes are left out (`scene/all_modes.rs`).
    pub atlas_residual_scale: f64,
    /// Outlier model of keypoints.
    pub kernel: OutlierModel,
    /// Steps of the solve.
    pub steps: Steps,
    /// Correlations of keypoint errors; `None` if errors are independent, as for synthetic noise.
    pub view_errors: Option<ViewErrors>,
    /// Stopping rules.
    pub lm: LmOptions,
    /// Least share of right keypoints of a car, 0–1; a car with a smaller share is rejected.
    pub min_inlier_share: f64,
    /// Largest cost of a car's fit, as a share of its cost if all keypoints were wrong; a car that costs more is
    /// rejected.
    ///
    /// Half of a false detection's keypoints may fit, but not well and not with a likely shape.
    pub max_cost_share: f64,
    /// Least number of right keypoints of a car; a car with fewer is rejected.
    pub min_inliers: usize,
}

impl SceneOptions {
    /// Returns the sds of the errors that cars share; 0 if their errors are independent.
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
            factors: Arc::new([]),
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
