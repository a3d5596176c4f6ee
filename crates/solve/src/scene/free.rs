//! Solves with free poses (6 degrees of freedom), as in the paper *Car Pose in Context*.
//!
//! These solves are the baseline for the joint solver, in which all cars are on a common plane.

use nalgebra::{Isometry3, Matrix4, Matrix6, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector4};
use roadplane_base::{Camera, CameraParams, ImageSize, KEYPOINTS, KeypointSet, MODES, Shape, ShapeAtlas};

use crate::linear::arrow::Joint;
use crate::linear::gram::Gram;
use crate::linear::lm::{LmOptions, LmReport, minimise};
use crate::model::free::{FREE, FreePose, PlaneTerms};
use crate::model::latent::body_types::{BodyTypes, ROUNDS_OF_TYPES};
use crate::model::observation::{Observation, observations};
use crate::model::points::PointModes;
use crate::model::pose::{CameraFrame, Pose as _};
use crate::options::{SceneOptions, ShapePrior};
use crate::problem::cars::FreeProblem;
use crate::problem::setup::Setup;
use crate::scene::fit::fits_from;
use crate::solution::{CarView, SceneStatus};
use crate::start::alternation::{LAST_TERMS, alternate};
use crate::start::weak_perspective::{Appearance, DirectionGrid};

/// Number of possible view directions per car that are used as starts of the descent.
const FOLLOWED: usize = 4;

/// The fit of one car with a free pose (6 degrees of freedom).
#[derive(Clone, Debug)]
pub struct FreeCarFit {
    /// Rigid transform from the car frame to the camera frame, m.
    pub camera_from_car: Isometry3<f64>,
    /// Covariance of the pose: rotation vector about the camera's axes (rad), then translation (m).
    pub pose_covariance: Matrix6<f64>,
    /// Shape coefficients. Each is in units of the coefficient's standard deviation over all cars.
    pub shape: Shape,
    /// Whether each keypoint is an inlier: more likely right than wrong.
    pub inliers: [bool; KEYPOINTS],
    /// Root mean square distance between the inliers and the projected keypoints of the fitted car, px.
    pub reprojection_rms_px: f64,
    /// Cost of the keypoints, without the shape prior.
    pub cost: f64,
}

/// Solution of a frame with free poses.
#[derive(Clone, Debug)]
pub struct FreeSceneSolution {
    /// Outcome of the solve.
    pub status: SceneStatus,
    /// Focal length and ground plane. If the solve had no plane terms, the plane is that of the prior.
    pub params: CameraParams,
    /// Covariance of (log f, tilt, roll, log h): logarithms of focal length and height, angles in rad.
    pub covariance: Matrix4<f64>,
    /// Fit of the car in each view, in the order of the input; `None` if the view could not be fitted.
    pub cars: Vec<Option<FreeCarFit>>,
}

/// Fits pose and shape of one car for a given camera, without a ground plane.
///
/// View directions all around the car are tried, so the keypoints decide between front and back. Returns `None` if
/// fewer than [`MIN_KEYPOINTS`](roadplane_base::MIN_KEYPOINTS) keypoints are usable, or if no pose can be evaluated.
#[must_use]
pub fn fit_free_car(
    atlas: &ShapeAtlas,
    camera: &Camera,
    keypoints: &KeypointSet,
    options: &SceneOptions,
) -> Option<FreeCarFit> {
    let model = PointModes::new(atlas);
    let found = observations(keypoints, camera, 1.0)?;
    let params = Vector4::new(camera.focal_px.ln(), 0.0, 0.0, 0.0);
    if !params[0].is_finite() {
        return None;
    }
    let mut problem = best_free(atlas, &model, &DirectionGrid::new(), params, &found, options)?;
    minimise_with_types(atlas, &mut problem, options)?;
    let joint = problem.only_view_covariance()?;
    read_car(&problem, 0, &joint)
}

/// Solves all cars of a frame with free poses, as in the paper *Car Pose in Context*.
///
/// If `plane` is given, soft terms pull the cars towards a common plane (paper, Eq. 7). The start comes from the
/// paper's Algorithm 1, and camera, poses and shapes are then refined jointly. The focal length may be unknown.
///
/// If `plane` is `None`, the focal length is hardly observable (paper, finding 1). So it is fixed: at the given value
/// if there is one, and at the mean of the prior otherwise.
///
/// Views of one group count as different cars.
#[must_use]
pub fn solve_free_scene(
    atlas: &ShapeAtlas,
    size: ImageSize,
    views: &[CarView<'_>],
    plane: Option<PlaneTerms>,
    options: &SceneOptions,
) -> FreeSceneSolution {
    let model = PointModes::new(atlas);
    let mut setup = Setup::new(atlas, &model, size, views, options);
    for usable_view in &mut setup.usable_views {
        usable_view.group = usable_view.index;
    }
    let focal_given = setup.knowledge.fixed[0];
    let mean = setup.knowledge.mean;
    let mut solution = FreeSceneSolution {
        status: SceneStatus::TooFewCars,
        params: CameraParams::from_vector(&mean),
        covariance: Matrix4::from_diagonal(&Vector4::from_fn(|i, _| {
            if setup.knowledge.fixed[i] { 0.0 } else { 1.0 / setup.knowledge.information[i] }
        })),
        cars: vec![None; views.len()],
    };
    let grid = DirectionGrid::new();
    let best =
        |found| best_free(atlas, &model, &grid, mean, found, options).map(|best| best.pose_and_shape(0));
    let placed: Vec<_> =
        setup.usable_views.iter().map(|usable_view| best(&usable_view.observations)).collect();
    let (mut problem, members) = setup.problem(mean, &placed);
    if members.is_empty() {
        return solution;
    }
    problem.knowledge.fixed =
        [focal_given || plane.is_none(), plane.is_none(), plane.is_none(), plane.is_none()];
    problem.whiten(options.atlas_residual_scale, 0.0);
    if let Some(terms) = plane {
        if !alternate(&mut problem, &options.lm) {
            problem.knowledge.fixed[0] = true;
        }
        problem.plane = Some(LAST_TERMS);
        problem.whiten(options.atlas_residual_scale, 0.02);
        minimise(&mut problem, &LmOptions { max_iterations: 15, ..options.lm });
        problem.plane = Some(terms);
        problem.whiten(options.atlas_residual_scale, 0.0);
    }
    solution.status = SceneStatus::Failed;
    let Some(report) = minimise_with_types(atlas, &mut problem, options) else { return solution };
    let Some(information) = problem.information() else { return solution };
    let camera = problem.state.camera;
    let Some(covariance) = problem.knowledge.covariance(&information) else { return solution };
    (solution.params, solution.covariance) = (CameraParams::from_vector(&camera), covariance);
    let is_determined = plane.is_some() && setup.knowledge.is_focal_determined(&information);
    solution.status = SceneStatus::of(report.termination, focal_given, is_determined);
    for (k, (s, joint)) in members.iter().zip(problem.view_covariances(&covariance)).enumerate() {
        solution.cars[setup.usable_views[*s].index] = read_car(&problem, k, &joint);
    }
    solution
}

/// Fits one car for a given camera from each of its possible view directions, and returns the fit of lowest cost.
fn best_free<'a>(
    atlas: &ShapeAtlas,
    model: &'a PointModes,
    grid: &DirectionGrid,
    camera: Vector4<f64>,
    found: &[Observation],
    options: &SceneOptions,
) -> Option<FreeProblem<'a>> {
    let appearances = grid.appearances(&atlas.mean, found, FOLLOWED);
    let starts = appearances.iter().map(|appearance| free_from(appearance, camera[0].exp()));
    let fits = fits_from(model, camera, found, &ShapePrior::default(), starts, options);
    fits.into_iter().map(|(_, problem)| problem).next()
}

/// Minimises the cost, and then repeats this with the shape prior of each car's likely body types.
///
/// Body types are not used if `atlas_residual_scale` is 0. Returns `None` if the pose of a car is not determined.
fn minimise_with_types(
    atlas: &ShapeAtlas,
    problem: &mut FreeProblem<'_>,
    options: &SceneOptions,
) -> Option<LmReport> {
    let mut report = minimise(problem, &options.lm);
    if options.atlas_residual_scale > 0.0 {
        let types = BodyTypes::new(atlas, options);
        for _ in 0..ROUNDS_OF_TYPES {
            problem.infer_body_types(&types)?;
            report = minimise(problem, &options.lm);
        }
    }
    Some(report)
}

fn free_from(appearance: &Appearance, focal_px: f64) -> FreePose {
    let rotation = Rotation3::from_matrix_unchecked(appearance.camera_from_car(focal_px));
    // A scale of s px/m means the depth f/s. So the ratio of depth to focal length is 1/s.
    FreePose {
        camera_from_car: UnitQuaternion::from_rotation_matrix(&rotation),
        anchor: appearance.origin,
        log_depth_ratio: -appearance.scale.ln(),
    }
}

fn read_car(problem: &FreeProblem<'_>, k: usize, joint: &Joint) -> Option<FreeCarFit> {
    const UNKNOWNS: usize = Gram::<FREE, MODES>::RESIDUAL;
    let (place, fit) = (problem.pose_and_shape(k), problem.fit_of(k)?);
    let frame = place.pose.frame(&CameraFrame::new(&problem.state.camera))?;
    // Derivative of (rotation vector, translation) with respect to all unknowns.
    let mut change = SMatrix::<f64, 6, UNKNOWNS>::zeros();
    let by_pose = frame.by_pose.iter().enumerate();
    let by_camera =
        frame.by_camera.iter().enumerate().map(|(i, twist)| (Gram::<FREE, MODES>::CAMERA + i, twist));
    for (column, twist) in by_pose.chain(by_camera) {
        change.fixed_view_mut::<3, 1>(0, column).copy_from(&twist.turn);
        change.fixed_view_mut::<3, 1>(3, column).copy_from(&twist.shift);
    }
    Some(FreeCarFit {
        camera_from_car: Isometry3::from_parts(Translation3::from(frame.origin), place.pose.camera_from_car),
        pose_covariance: change * joint.fixed_view::<UNKNOWNS, UNKNOWNS>(0, 0) * change.transpose(),
        shape: place.shape,
        inliers: fit.inliers,
        reprojection_rms_px: fit.rms_px,
        cost: fit.cost,
    })
}
