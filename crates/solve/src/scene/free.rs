//! Cars without being told that they stand on a plane: the paper's own path, and the ablation of the joint solver.

use nalgebra::{
    Isometry3, Matrix3, Matrix4, Matrix6, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector4,
};
use roadplane_base::{
    Camera, CameraParams, ImageSize, KEYPOINTS, KeypointSet, MIN_KEYPOINTS, Shape, ShapeAtlas, is_told,
};

use crate::linear::lm::{LmOptions, LmReport, Problem as _, minimise};
use crate::model::camera_prior::CameraKnowledge;
use crate::model::free::{FreeCar, FreeFrame};
use crate::model::ground::PointModes;
use crate::model::latent::body_types::{BodyTypes, Gaussian, ROUNDS_OF_TYPES};
use crate::model::observation::{Observation, observations};
use crate::options::SceneOptions;
use crate::problem::free::{FreeProblem, PlaneTerms};
use crate::problem::setup::Setup;
use crate::solution::{CarView, SceneStatus};
use crate::start::alternation::{LAST_TERMS, alternate};
use crate::start::weak_perspective::{Appearance, DirectionGrid};

/// Views of a car that are followed to their minimum.
const FOLLOWED: usize = 4;
/// As in the joint solver: sd that shapes not yet found add, and the easing of their prior.
const STAGES: [(f64, f64); 3] = [(0.12, 0.1), (0.04, 0.4), (0.0, 1.0)];

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
/// back and the flip of flat views are decided by the evidence. `None` with fewer than [`MIN_KEYPOINTS`] usable ones.
#[must_use]
pub fn fit_free_car(
    atlas: &ShapeAtlas,
    camera: &Camera,
    keypoints: &KeypointSet,
    options: &SceneOptions,
) -> Option<FreeCarFit> {
    let model = PointModes::new(atlas);
    let mut found = Vec::new();
    observations(keypoints, camera, 1.0, &mut found);
    let known = Vector4::new(camera.focal_px.ln(), 0.0, 0.0, 0.0);
    if found.len() < MIN_KEYPOINTS || !known[0].is_finite() {
        return None;
    }
    let knowledge = CameraKnowledge::given(known);
    let car = best_free(atlas, &model, &DirectionGrid::new(), &knowledge, &found, options)?;
    let mut problem = FreeProblem::new(atlas, &model, vec![found], knowledge, known, vec![car]);
    problem.kernel = options.kernel;
    problem.priors.fill(Gaussian::of_all_cars(options.shape_prior_weight));
    problem.whiten(options.atlas_residual_scale, 0.0);
    minimise_with_types(atlas, &mut problem, options);
    let (_, _, covariances) = problem.covariances()?;
    read_car(&problem, &model, 0, covariances.first()?, options)
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
    let setup = Setup::new(atlas, &model, size, views, options);
    let mut knowledge = setup.knowledge.clone();
    let focal_known = knowledge.fixed[0];
    let mut solution = FreeSceneSolution {
        status: SceneStatus::TooFewCars,
        params: CameraParams::from_vector(&knowledge.mean),
        covariance: Matrix4::from_diagonal(&knowledge.information.map(|i| 1.0 / i)),
        cars: vec![None; views.len()],
    };
    let at_start = CameraKnowledge { fixed: [true; 4], ..knowledge.clone() };
    let grid = DirectionGrid::new();
    let mut cars = Vec::new();
    let mut seen = Vec::new();
    for sight in &setup.sights {
        let found = &sight.observations;
        if let Some(car) = best_free(atlas, &model, &grid, &at_start, found, options) {
            cars.push(car);
            seen.push(sight);
        }
    }
    if cars.is_empty() {
        return solution;
    }
    let all = seen.iter().map(|sight| sight.observations.clone()).collect();
    knowledge.fixed = [focal_known || plane.is_none(), plane.is_none(), plane.is_none(), plane.is_none()];
    let mut problem = FreeProblem::new(atlas, &model, all, knowledge.clone(), knowledge.mean, cars);
    problem.priors.fill(Gaussian::of_all_cars(options.shape_prior_weight));
    problem.kernel = options.kernel;
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
    let report = minimise_with_types(atlas, &mut problem, options);
    let Some((information, camera, covariances)) = problem.covariances() else {
        solution.status = SceneStatus::Failed;
        return solution;
    };
    solution.params = CameraParams::from_vector(&problem.camera);
    solution.covariance = camera;
    solution.status = if !report.termination.converged() {
        SceneStatus::NotConverged
    } else if focal_known {
        SceneStatus::FocalGiven
    } else if plane.is_none() || !is_told(0, &information, &options.camera_prior.information()) {
        SceneStatus::FocalFromPrior
    } else {
        SceneStatus::Converged
    };
    for (k, sight) in seen.iter().enumerate() {
        solution.cars[sight.index] = read_car(&problem, &model, k, &covariances[k], options);
    }
    solution
}

/// The best of a car's possible views, refined with shape; camera fixed.
fn best_free(
    atlas: &ShapeAtlas,
    model: &PointModes,
    grid: &DirectionGrid,
    knowledge: &CameraKnowledge,
    found: &[Observation],
    options: &SceneOptions,
) -> Option<FreeCar> {
    let focal_px = knowledge.mean[0].exp();
    let mut best: Option<(f64, FreeCar)> = None;
    for appearance in grid.appearances(&atlas.mean, found, FOLLOWED) {
        let car = free_from(&appearance, focal_px);
        let mut problem = FreeProblem::new(
            atlas,
            model,
            vec![found.to_vec()],
            knowledge.clone(),
            knowledge.mean,
            vec![car],
        );
        problem.kernel = options.kernel;
        problem.shapes_fixed = true;
        let short =
            LmOptions { max_iterations: 10, cost_tolerance: 1e-3, step_tolerance: 1e-2, ..options.lm };
        problem.whiten(options.atlas_residual_scale, 0.12);
        minimise(&mut problem, &short);
        for (extra_m, ease) in STAGES {
            problem.shapes_fixed = false;
            problem.priors.fill(Gaussian::of_all_cars(options.shape_prior_weight * ease));
            problem.whiten(options.atlas_residual_scale, extra_m);
            minimise(&mut problem, &short);
        }
        if problem.linearise().is_some() && best.as_ref().is_none_or(|(lowest, _)| problem.cost() < *lowest) {
            best = Some((problem.cost(), problem.cars[0]));
        }
    }
    best.map(|(_, car)| car)
}

/// To the minimum, each car with the prior of the body types that it may have, unless cars are exactly in the atlas.
fn minimise_with_types(
    atlas: &ShapeAtlas,
    problem: &mut FreeProblem<'_>,
    options: &SceneOptions,
) -> LmReport {
    let mut report = minimise(problem, &options.lm);
    if options.atlas_residual_scale > 0.0 {
        let types = BodyTypes::new(atlas, options);
        for _ in 0..ROUNDS_OF_TYPES {
            problem.tell_types(&types);
            report = minimise(problem, &options.lm);
        }
    }
    report
}

fn free_from(appearance: &Appearance, focal_px: f64) -> FreeCar {
    let rotation = Rotation3::from_matrix_unchecked(appearance.camera_from_car(focal_px));
    // s px/m means a depth of f/s, that is e^ρ = 1/s.
    FreeCar {
        camera_from_car: UnitQuaternion::from_rotation_matrix(&rotation),
        anchor: appearance.origin,
        log_depth_ratio: -appearance.scale.ln(),
        shape: Shape::zeros(),
    }
}

fn read_car(
    problem: &FreeProblem<'_>,
    model: &PointModes,
    k: usize,
    covariance: &SMatrix<f64, 12, 12>,
    options: &SceneOptions,
) -> Option<FreeCarFit> {
    let car = problem.cars.get(k)?;
    let frame = FreeFrame::new(problem.camera[0].exp(), car);
    let mut inliers = [false; KEYPOINTS];
    let (mut sum, mut count, mut cost) = (0.0, 0.0, 0.0);
    for o in &problem.observations[k] {
        let off = frame.project(&model.point(o.index, &car.shape))? - o.pixel;
        let [rx, ry] = o.whiten([off.x, off.y]);
        let squared = rx * rx + ry * ry;
        cost += 0.5 * o.weight * options.kernel.cost(squared);
        inliers[o.index] = options.kernel.weight(squared) > 0.5;
        if inliers[o.index] {
            sum += off.norm_squared();
            count += 1.0;
        }
    }
    // (ω, u, v, ρ) → (ω, T)
    let ratio = car.log_depth_ratio.exp();
    let mut by = Matrix6::identity();
    let position = Matrix3::new(
        ratio,
        0.0,
        frame.origin.x, //
        0.0,
        ratio,
        frame.origin.y, //
        0.0,
        0.0,
        frame.origin.z,
    );
    by.fixed_view_mut::<3, 3>(3, 3).copy_from(&position);
    let pose: Matrix6<f64> = covariance.fixed_view::<6, 6>(6, 6).into_owned();
    Some(FreeCarFit {
        camera_from_car: Isometry3::from_parts(Translation3::from(frame.origin), car.camera_from_car),
        pose_covariance: by * pose * by.transpose(),
        shape: car.shape,
        inliers,
        reprojection_rms_px: if count > 0.0 { f64::sqrt(sum / count) } else { f64::INFINITY },
        cost,
    })
}
