//! Refinement of the camera with all modes of the shape atlas, after the solve with its first 6 modes.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{ALL_MODES, JointInformation, MODES, ShapeAtlas};

use crate::linear::lm::{LmOptions, minimise};
use crate::model::latent::body_types::{BodyTypes, Gaussian, ROUNDS_OF_TYPES};
use crate::model::points::PointModes;
use crate::options::SceneOptions;
use crate::problem::cars::GroundProblem;

/// Number of rounds. In each round, the weights of the cars are updated, and the cost is minimised with the new
/// weights.
const ROUNDS_OF_TRUST: usize = 3;

/// The estimated camera with its uncertainty.
pub(crate) struct FineCamera {
    /// Estimated parameters (log focal length, tilt, roll, log height).
    pub camera: Vector4<f64>,
    /// Information of the cars alone, without the camera's prior.
    pub information: JointInformation,
    /// Covariance of the parameters, with the prior; rows of fixed parameters are zero.
    pub covariance: Matrix4<f64>,
}

/// Refines the camera with all modes of the atlas, starting from the minimum of `problem`.
///
/// Returns `None` if this step is switched off, or if a car cannot be evaluated.
pub(crate) fn camera_of_all_modes(
    atlas: &ShapeAtlas,
    problem: &GroundProblem<'_, MODES>,
    options: &SceneOptions,
) -> Option<FineCamera> {
    let scale = options.atlas_residual_scale;
    if !(options.steps.all_modes && scale.is_finite() && scale > 0.0) {
        return None;
    }
    let model = PointModes::of_all_modes(atlas);
    let mut all = problem.with_modes(&model, |coarse| Gaussian::of_all_modes(coarse, scale.powi(-2)));
    // The start is near the minimum, so steps need little damping.
    let lm = LmOptions { initial_damping: 1e-6, ..options.lm };
    let descend = |all: &mut GroundProblem<'_, ALL_MODES>| minimise(all, &lm).cost.is_finite().then_some(());
    // The first descent uses the larger keypoint sds of the first modes. So no keypoint becomes an outlier before the
    // fine modes are fitted.
    descend(&mut all)?;
    all.whiten(scale, 0.0);
    descend(&mut all)?;
    let types = BodyTypes::new(atlas, options);
    for _ in 0..ROUNDS_OF_TYPES {
        all.infer_body_types(&types)?;
        descend(&mut all)?;
    }
    for _ in 0..if options.steps.trust { ROUNDS_OF_TRUST } else { 0 } {
        all.update_trust();
        descend(&mut all)?;
    }
    camera_of_cars(&mut all, options)
}

/// Returns the camera at a problem's minimum, corrected for its bias and for the mean error of the elevation.
///
/// The covariance includes the errors that all cars share. Returns `None` if a car cannot be evaluated.
pub(crate) fn camera_of_cars<const M: usize>(
    problem: &mut GroundProblem<'_, M>,
    options: &SceneOptions,
) -> Option<FineCamera> {
    let (mut camera, alone) = (problem.state.camera, problem.information()?);
    let information = match &options.view_errors {
        Some(errors) => problem.joint_information(errors)?,
        None => JointInformation::of_camera(&alone, &camera),
    };
    if options.steps.bias {
        // The correction uses the covariance without correlated errors, because correlations do not move the minimum.
        let covariance = problem.knowledge.covariance(&alone)?;
        camera += problem.bias_correction(&covariance).unwrap_or_default();
    }
    let (cars, vector) = information.marginal(options.shared_sd());
    let covariance = problem.knowledge.covariance(&cars)?;
    if options.view_errors.is_some() {
        camera += covariance * (vector - cars * problem.state.camera);
    }
    Some(FineCamera { camera, information, covariance })
}
