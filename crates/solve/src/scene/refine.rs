//! From a scene that is already known roughly or exactly: the joint refinement alone, and the Cramér–Rao bound.

use roadplane_base::{CameraParams, GroundPose, ImageSize, Shape, ShapeAtlas};

use crate::linear::lm::{LmReport, Problem as _, Termination, minimise};
use crate::model::points::PointModes;
use crate::model::pose::CameraFrame;
use crate::model::standing::Standing;
use crate::options::SceneOptions;
use crate::problem::setup::{Placed, Setup};
use crate::scene::read_out::read_out;
use crate::solution::{CarView, SceneSolution};

/// A scene to start from: camera, and per view pose and shape.
#[derive(Clone, Copy, Debug)]
pub struct GivenScene<'a> {
    /// Focal length and plane.
    pub params: CameraParams,
    /// Pose per view.
    pub poses: &'a [GroundPose],
    /// Shape per view; views of a group take the first one's.
    pub shapes: &'a [Shape],
}

/// The joint refinement from a given scene, without search, repair or rejection. `None` when the lists differ in length,
/// no view is usable, or the start cannot be evaluated.
#[must_use]
pub fn refine_scene(
    atlas: &ShapeAtlas,
    size: ImageSize,
    views: &[CarView<'_>],
    from: &GivenScene<'_>,
    options: &SceneOptions,
) -> Option<SceneSolution> {
    known(atlas, size, views, from, options, true)
}

/// Covariances at a given scene, nothing moved. At the truth, with the outlier model off and only right keypoints given, they
/// are the Cramér–Rao bound (Bayesian in the shapes).
#[must_use]
pub fn scene_bound(
    atlas: &ShapeAtlas,
    size: ImageSize,
    views: &[CarView<'_>],
    at: &GivenScene<'_>,
    options: &SceneOptions,
) -> Option<SceneSolution> {
    known(atlas, size, views, at, options, false)
}

fn known(
    atlas: &ShapeAtlas,
    size: ImageSize,
    views: &[CarView<'_>],
    scene: &GivenScene<'_>,
    options: &SceneOptions,
    refined: bool,
) -> Option<SceneSolution> {
    if scene.poses.len() != views.len() || scene.shapes.len() != views.len() {
        return None;
    }
    let model = PointModes::new(atlas);
    let setup = Setup::new(atlas, &model, size, views, options);
    let camera = scene.params.to_vector();
    let frame = CameraFrame::new(&camera);
    let place = |index: usize| {
        Some(Placed { pose: Standing::of(&scene.poses[index], &frame)?, shape: scene.shapes[index] })
    };
    let placed: Vec<_> = setup.sights.iter().map(|sight| place(sight.index)).collect();
    let (mut problem, members) = setup.problem(camera, &placed);
    problem.whiten(options.atlas_residual_scale, 0.0);
    let report = if refined {
        minimise(&mut problem, &options.lm)
    } else {
        problem.linearise()?;
        LmReport { termination: Termination::MaxIterations, iterations: 0, cost: problem.cost() }
    };
    (report.termination != Termination::Failed && !members.is_empty())
        .then(|| read_out(&setup, &mut problem, &members, &report, views))
}
