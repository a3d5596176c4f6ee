//! Cars without being told that they stand on a plane: the paper's own path, and the ablation of the joint solver.

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

/// Views of a car that are followed to their minimum.
const FOLLOWED: usize = 4;

/// A car with a free pose.
#[derive(Clone, Debug)]
pub struct FreeCarFit {
    /// Rigid motion from the car's to the camera's frame.
    pub camera_from_car: Isometry3<f64>,
    /// Covariance of (ω rad: turn about the camera's axes; translation m).
    pub pose_covariance: Matrix6<f64>,
    /// Shape coefficients, each in units of its sd over all cars.
    pub shape: Shape,
    /// Keypoints that are more likely right than wrong.
    pub inliers: [bool; KEYPOINTS],
    /// Root mean square distance of the inliers from their projections, px.
    pub reprojection_rms_px: f64,
    /// Cost of the fit.
    pub cost: f64,
}

/// A frame's answer with free poses.
#[derive(Clone, Debug)]
pub struct FreeSceneSolution {
    /// How it ended.
    pub status: SceneStatus,
    /// Focal length and, where plane terms were used, the plane (else the prior's).
    pub params: CameraParams,
    /// Covariance of (log f, tilt, roll, log h).
    pub covariance: Matrix4<f64>,
    /// Per view; `None` where nothing could be fitted.
    pub cars: Vec<Option<FreeCarFit>>,
}

/// Pose and shape of one car before a known camera, nothing known of the ground. All view directions are tried, so front and
/// back and the flip of flat views are decided by the evidence. `None` with fewer than
/// [`MIN_KEYPOINTS`](roadplane_base::MIN_KEYPOINTS) usable ones.
#[must_use]
pub fn fit_free_car(
    atlas: &ShapeAtlas,
    camera: &Camera,
    keypoints: &KeypointSet,
    options: &SceneOptions,
) -> Option<FreeCarFit> {
    let model = PointModes::new(atlas);
    let found = observations(keypoints, camera, 1.0)?;
    let known = Vector4::new(camera.focal_px.ln(), 0.0, 0.0, 0.0);
    if !known[0].is_finite() {
        return None;
    }
    let mut problem = best_free(atlas, &model, &DirectionGrid::new(), known, &found, options)?;
    minimise_with_types(atlas, &mut problem, options)?;
    let joint = problem.only_view_covariance()?;
    read_car(&problem, 0, &joint)
}

/// Free poses of all cars of a frame. With `plane`, cars are drawn to a common plane with these sd (the paper's Eq. 7, solved
/// by its Algorithm 1 and then jointly); the focal length may then be unknown. Without a plane and without a known focal
/// length the problem is all but unobservable (the paper's finding 1) and the prior's focal length is used. Views of one
/// group are taken for different cars.
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
    for sight in &mut setup.sights {
        sight.group = sight.index;
    }
    let focal_known = setup.knowledge.fixed[0];
    let mean = setup.knowledge.mean;
    let mut solution = FreeSceneSolution {
        status: SceneStatus::TooFewCars,
        params: CameraParams::from_vector(&mean),
        covariance: Matrix4::from_diagonal(&setup.knowledge.information.map(|i| 1.0 / i)),
        cars: vec![None; views.len()],
    };
    let grid = DirectionGrid::new();
    let best = |found| best_free(atlas, &model, &grid, mean, found, options).map(|best| best.placed(0));
    let placed: Vec<_> = setup.sights.iter().map(|sight| best(&sight.observations)).collect();
    let (mut problem, members) = setup.problem(mean, &placed);
    if members.is_empty() {
        return solution;
    }
    problem.knowledge.fixed =
        [focal_known || plane.is_none(), plane.is_none(), plane.is_none(), plane.is_none()];
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
    let Some(covariance) = problem.knowledge.covariance(&information, &camera) else { return solution };
    (solution.params, solution.covariance) = (CameraParams::from_vector(&camera), covariance);
    let is_determined = plane.is_some() && setup.knowledge.is_focal_determined(&information, &camera);
    solution.status = SceneStatus::of(report.termination, focal_known, is_determined);
    for (k, (s, joint)) in members.iter().zip(problem.view_covariances(&covariance)).enumerate() {
        solution.cars[setup.sights[*s].index] = read_car(&problem, k, &joint);
    }
    solution
}

/// The best of a car's possible views, followed to its minimum before a known camera.
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

/// To the minimum, each car with the prior of the body types that it may have, unless cars are exactly in the atlas.
fn minimise_with_types(
    atlas: &ShapeAtlas,
    problem: &mut FreeProblem<'_>,
    options: &SceneOptions,
) -> Option<LmReport> {
    let mut report = minimise(problem, &options.lm);
    if options.atlas_residual_scale > 0.0 {
        let types = BodyTypes::new(atlas, options);
        for _ in 0..ROUNDS_OF_TYPES {
            problem.tell_types(&types)?;
            report = minimise(problem, &options.lm);
        }
    }
    Some(report)
}

fn free_from(appearance: &Appearance, focal_px: f64) -> FreePose {
    let rotation = Rotation3::from_matrix_unchecked(appearance.camera_from_car(focal_px));
    // s px/m means a depth of f/s, that is e^ρ = 1/s.
    FreePose {
        camera_from_car: UnitQuaternion::from_rotation_matrix(&rotation),
        anchor: appearance.origin,
        log_depth_ratio: -appearance.scale.ln(),
    }
}

fn read_car(problem: &FreeProblem<'_>, k: usize, joint: &Joint) -> Option<FreeCarFit> {
    const UNKNOWNS: usize = Gram::<FREE, MODES>::RESIDUAL;
    let (place, fit) = (problem.placed(k), problem.fit_of(k)?);
    let frame = place.pose.frame(&CameraFrame::new(&problem.state.camera))?;
    // (ω, T) by all unknowns
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
