//! The last steps: the camera of the first modes is refined with all modes of the atlas.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{ALL_MODES, JointInformation, MODES, ShapeAtlas};

use crate::linear::lm::{LmOptions, minimise};
use crate::model::latent::body_types::{BodyTypes, Gaussian, ROUNDS_OF_TYPES};
use crate::model::points::PointModes;
use crate::options::SceneOptions;
use crate::problem::cars::GroundProblem;

/// Number of rounds. Each round updates the trust in every car, and minimises with the new weights.
const ROUNDS_OF_TRUST: usize = 3;

/// The estimated camera with its uncertainty.
pub(crate) struct FineCamera {
    /// (log focal, tilt, roll, log height).
    pub camera: Vector4<f64>,
    /// Information of the cars, without prior and factors.
    pub information: JointInformation,
    /// Covariance, with prior and factors; rows of fixed parameters are zero.
    pub covariance: Matrix4<f64>,
}

/// Refines the camera with all modes, from the minimum of `problem`.
///
/// Returns `None` if the step is switched off, or if a car cannot be evaluated.
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
    // First with the wider sd of the first modes, so that no keypoint counts as wrong before the fine modes fit it.
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

/// Returns the camera at a problem's minimum, with its bias corrected and the cars' shared errors in its covariance.
///
/// Returns `None` if a car cannot be evaluated.
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
        // The correction uses the covariance without view errors, since those do not move the minimum.
        let covariance = problem.knowledge.covariance(&alone, &camera)?;
        camera += problem.bias_correction(&covariance).unwrap_or_default();
    }
    let (cars, _) = information.marginal(options.shared_sd());
    let covariance = problem.knowledge.covariance(&cars, &camera)?;
    Some(FineCamera { camera, information, covariance })
}
