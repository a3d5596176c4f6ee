//! Solves that start from a given scene: joint refinement without a search, and the Cramér–Rao bound.

use roadplane_base::{CameraParams, GroundPose, ImageSize, Shape, ShapeAtlas};

use crate::linear::lm::{LmReport, Problem as _, Termination, minimise};
use crate::model::on_plane::PlanePose;
use crate::model::points::PointModes;
use crate::model::pose::CameraFrame;
use crate::options::SceneOptions;
use crate::problem::setup::{PoseAndShape, Setup};
use crate::scene::read_out::read_out;
use crate::solution::{CarView, SceneSolution};

/// Given values of a scene: the camera, and the pose and shape of the car in each view.
#[derive(Clone, Copy, Debug)]
pub struct GivenScene<'a> {
    /// Focal length, tilt, roll and height of the camera.
    pub params: CameraParams,
    /// Pose of the car in each view.
    pub poses: &'a [GroundPose],
    /// Shape of the car in each view. For several views of one car, the first view's shape is used.
    pub shapes: &'a [Shape],
}

/// Refines camera, poses and shapes jointly, starting from the given scene.
///
/// Nothing is searched, rejected or reclassified. Returns `None` if the lists differ in length, if no view is usable,
/// or if the cost cannot be evaluated at the start.
#[must_use]
pub fn refine_scene(
    atlas: &ShapeAtlas,
    size: ImageSize,
    views: &[CarView<'_>],
    from: &GivenScene<'_>,
    options: &SceneOptions,
) -> Option<SceneSolution> {
    at_given_scene(atlas, size, views, from, options, true)
}

/// Returns the given scene unchanged, with the covariances of its parameters.
///
/// If the given scene is the true one, the covariances are the Cramér–Rao bound, with shapes treated as random. For
/// this, the outlier model must be switched off and all keypoints must be right. Returns `None` in the same cases as
/// [`refine_scene`].
#[must_use]
pub fn scene_bound(
    atlas: &ShapeAtlas,
    size: ImageSize,
    views: &[CarView<'_>],
    at: &GivenScene<'_>,
    options: &SceneOptions,
) -> Option<SceneSolution> {
    at_given_scene(atlas, size, views, at, options, false)
}

fn at_given_scene(
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
        Some(PoseAndShape { pose: PlanePose::of(&scene.poses[index], &frame)?, shape: scene.shapes[index] })
    };
    let placed: Vec<_> = setup.usable_views.iter().map(|usable_view| place(usable_view.index)).collect();
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
