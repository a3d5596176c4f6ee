//! What a caller can set.

use std::sync::Arc;

use nalgebra::Matrix6;
use roadplane_base::{CameraParams, CameraPrior, Factor, Lens, SHARED_ERRORS, Shape, SharedSd};

use crate::linear::lm::LmOptions;
use crate::model::kernel::OutlierModel;

/// What is known of a car's shape: a Gaussian on its coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapePrior {
    /// Mean coefficients.
    pub mean: Shape,
    /// Inverse covariance; zero for "nothing known".
    pub information: Matrix6<f64>,
    /// Hold the shape at the mean.
    pub fixed: bool,
}

impl Default for ShapePrior {
    /// The population: N(0, I).
    fn default() -> Self {
        Self { mean: Shape::zeros(), information: Matrix6::identity(), fixed: false }
    }
}

impl ShapePrior {
    /// A known shape.
    #[must_use]
    pub fn known(shape: Shape) -> Self {
        Self { mean: shape, information: Matrix6::identity(), fixed: true }
    }
}

/// Steps of a solve that can be switched off, all on by default: `roadplane eval solver --layers` shows what each is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Steps {
    /// What does not fit as a car is left out (`scene/rejection.rs`).
    pub rejection: bool,
    /// Single keypoints are taken for wrong, or right, by turns (`scene/reclassify.rs`).
    pub reclassify: bool,
    /// The camera is that of all modes of the atlas (`scene/all_modes.rs`), which the next two belong to. Neither is done where
    /// [`SceneOptions::atlas_residual_scale`] is 0.
    pub all_modes: bool,
    /// A car's prior is that of the body types that it may have (`model/latent/body_types.rs`), also of cars free of the plane.
    pub body_types: bool,
    /// A car that fits worse than others says less of the camera (`model/latent/trust.rs`).
    pub trust: bool,
    /// The bias of the minimum is taken from the camera (`problem/cars/bias.rs`): 0 without noise, a fraction of a sd with it.
    pub bias: bool,
}

impl Default for Steps {
    fn default() -> Self {
        Self { rejection: true, reclassify: true, all_modes: true, body_types: true, trust: true, bias: true }
    }
}

/// What the errors of keypoints have in common, as nets make them (`problem/cars/joint.rs`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewErrors {
    /// So many keypoints of a car are off together as one: 1 where each is off by itself.
    pub keypoints_as_one: f64,
    /// What is common to all cars of a place: sds of the angle at which they are seen from above and of their turn about the line of
    /// sight (rad), then of lens and principal point.
    pub shared_sd: SharedSd,
}

/// How a scene or a car is solved.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneOptions {
    /// Focal length where it is known, px.
    pub given_focal_px: Option<f64>,
    /// Where to start instead of searching: the answer for the previous frame, say. Falls back to searching when the
    /// cars do not fit there.
    pub start: Option<CameraParams>,
    /// How the lens bends lines. What is not known of it counts as an error that cars share ([`ViewErrors::shared_sd`]).
    pub lens: Lens,
    /// What is known of the camera.
    pub camera_prior: CameraPrior,
    /// What else speaks of it. Part of the estimate and its covariance, not of [`SceneSolution::information`](crate::SceneSolution).
    pub factors: Arc<[Factor]>,
    /// Factor on what the atlas says its six modes leave unexplained; 0 for cars that are exactly in the atlas, which also
    /// spares the steps with all modes (`scene/all_modes.rs`).
    pub atlas_residual_scale: f64,
    /// Outlier model of keypoints.
    pub kernel: OutlierModel,
    /// Which steps of the solve are done.
    pub steps: Steps,
    /// What the errors of a car's keypoints, and of all cars, have in common; `None` where nothing: synthetic noise.
    pub view_errors: Option<ViewErrors>,
    /// Stopping rules.
    pub lm: LmOptions,
    /// A car with a smaller share of right keypoints is left out.
    pub min_inlier_share: f64,
    /// A car whose fit costs more than this share of what it would cost were all its keypoints wrong is left out: half the
    /// keypoints of a false detection may be fitted, but not well and not with a likely shape.
    pub max_cost_share: f64,
    /// A car with fewer right keypoints is left out.
    pub min_inliers: usize,
}

impl SceneOptions {
    /// sds of what cars share: 0 where their errors are independent.
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
