//! The last steps: from the camera of the first modes to that of all modes of the atlas.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{ALL_MODES, JointInformation, MODES, ShapeAtlas};

use crate::linear::lm::{LmOptions, minimise};
use crate::model::latent::body_types::{BodyTypes, Gaussian, ROUNDS_OF_TYPES};
use crate::model::points::PointModes;
use crate::options::SceneOptions;
use crate::problem::cars::GroundProblem;

/// Rounds of weighing cars and descending with the new weights.
const ROUNDS_OF_TRUST: usize = 3;

/// What all modes say of the camera.
pub(crate) struct FineCamera {
    /// Log focal, tilt, roll, log height.
    pub camera: Vector4<f64>,
    /// What the cars say, prior not counted.
    pub information: JointInformation,
    /// Covariance, prior counted; zero rows where fixed.
    pub covariance: Matrix4<f64>,
}

/// Goes on from the minimum of `problem`. `None` where nothing is unexplained, or a car cannot be evaluated.
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
    // It is near: steps need little damping.
    let lm = LmOptions { initial_damping: 1e-6, ..options.lm };
    let descend = |all: &mut GroundProblem<'_, ALL_MODES>| minimise(all, &lm).cost.is_finite().then_some(());
    // First with the wider sd of before, so that no keypoint that the fine modes explain is taken for wrong.
    descend(&mut all)?;
    all.whiten(scale, 0.0);
    descend(&mut all)?;
    let types = BodyTypes::new(atlas, options);
    for _ in 0..ROUNDS_OF_TYPES {
        all.tell_types(&types)?;
        descend(&mut all)?;
    }
    for _ in 0..if options.steps.trust { ROUNDS_OF_TRUST } else { 0 } {
        all.weigh();
        descend(&mut all)?;
    }
    told(&mut all, options)
}

/// What the cars of a problem at its minimum say of the camera: with the errors that they share in its covariance, its bias taken away.
/// `None` when a car cannot be evaluated.
pub(crate) fn told<const M: usize>(
    problem: &mut GroundProblem<'_, M>,
    options: &SceneOptions,
) -> Option<FineCamera> {
    let (mut camera, alone) = (problem.state.camera, problem.information()?);
    let information = match &options.view_errors {
        Some(errors) => problem.joint_information(errors)?,
        None => JointInformation::of_camera(&alone, &camera),
    };
    if options.steps.bias {
        // As far as the minimum moves, which errors of view do not.
        let covariance = problem.knowledge.covariance(&alone, &camera)?;
        camera += problem.bias_correction(&covariance).unwrap_or_default();
    }
    let (cars, _) = information.marginal(options.shared_sd());
    let covariance = problem.knowledge.covariance(&cars, &camera)?;
    Some(FineCamera { camera, information, covariance })
}
