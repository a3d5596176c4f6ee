//! One car on a known plane before a known camera.

use nalgebra::{SMatrix, Vector4};
use roadplane_base::{Camera, CameraParams, GroundPlane, GroundPose, KeypointSet, MIN_KEYPOINTS, ShapeAtlas};

use crate::linear::lm::{LmOptions, minimise};
use crate::model::camera_prior::CameraKnowledge;
use crate::model::ground::{CameraFrame, PointModes, Standing};
use crate::model::latent::body_types::Gaussian;
use crate::model::observation::{Observation, observations};
use crate::options::{SceneOptions, ShapePrior};
use crate::problem::ground::{GroundProblem, GroundState, Group, View};
use crate::scene::approach::approach;
use crate::scene::car::car_solution;
use crate::solution::CarSolution;
use crate::start::cold_start::COARSE_SD_M;
use crate::start::standing::standing_candidates;

/// Headings that are followed to their minimum.
const FOLLOWED: usize = 4;

/// A fitted car.
#[derive(Clone, Debug)]
pub struct CarFit {
    /// Pose, shape, inliers. Its covariances hold camera and plane for exact.
    pub car: CarSolution,
    /// Joint covariance of (x m, y m, heading rad, λ_1 … λ_6).
    pub covariance: SMatrix<f64, 9, 9>,
    /// Cost of the fit.
    pub cost: f64,
    /// How much the best differently headed pose costs more; infinite if there is none. Below about 5 the heading is a guess.
    pub margin: f64,
}

/// Fits pose and shape of one car. `start` is tried beside the ring of headings, so front and back are told apart by the
/// evidence every time. `None` when fewer than [`MIN_KEYPOINTS`] are usable, no pose can be evaluated, or camera and plane
/// are not finite.
#[must_use]
pub fn fit_car(
    atlas: &ShapeAtlas,
    camera: &Camera,
    plane: &GroundPlane,
    keypoints: &KeypointSet,
    shape: &ShapePrior,
    start: Option<&GroundPose>,
    options: &SceneOptions,
) -> Option<CarFit> {
    let params = CameraParams::new(camera.focal_px, plane).to_vector();
    if !params.iter().all(|v| v.is_finite()) {
        return None;
    }
    let model = PointModes::new(atlas);
    let mut found = Vec::new();
    observations(keypoints, camera, 1.0, &mut found);
    if found.len() < MIN_KEYPOINTS {
        return None;
    }
    let frame = CameraFrame::new(&params);
    let points = atlas.keypoints_in_car(&shape.mean);
    let mut starts: Vec<Standing> = standing_candidates(&frame, &points, &found, FOLLOWED)
        .into_iter()
        .map(|(_, standing)| standing)
        .collect();
    if let Some(pose) = start {
        let anchor = frame.anchor_of(pose);
        starts.extend(anchor.map(|anchor| Standing { anchor, heading: pose.heading_rad }));
    }
    let mut fits: Vec<(f64, GroundProblem<'_>)> = Vec::new();
    for standing in starts {
        let mut problem = single_car(&model, params, found.clone(), standing, shape);
        if let Some(cost) = refine_car(&mut problem, shape.fixed, options) {
            fits.push((cost, problem));
        }
    }
    fits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (cost, mut problem) = if fits.is_empty() { return None } else { fits.remove(0) };
    let heading = problem.state.standings[0].heading;
    let elsewhere = |other: &GroundProblem<'_>| {
        roadplane_base::angle_difference(other.state.standings[0].heading, heading).abs() > 0.5
    };
    let margin = fits.iter().find(|(_, p)| elsewhere(p)).map_or(f64::INFINITY, |(other, _)| other - cost);
    let joint = problem.only_view_covariance()?;
    let (mut car, covariance) = car_solution(&problem, 0, &joint)?;
    let right = car.inliers.iter().filter(|inlier| **inlier).count();
    car.used = right >= options.min_inliers && right as f64 >= options.min_inlier_share * found.len() as f64;
    Some(CarFit { car, covariance, cost, margin })
}

fn single_car<'a>(
    model: &'a PointModes,
    params: Vector4<f64>,
    found: Vec<Observation>,
    standing: Standing,
    shape: &ShapePrior,
) -> GroundProblem<'a> {
    let views = vec![View::new(0, 0..found.len())];
    let groups = vec![Group::new(0..1, Gaussian { mean: shape.mean, information: shape.information })];
    let knowledge = CameraKnowledge::given(params);
    let state = GroundState { camera: params, standings: vec![standing], shapes: vec![shape.mean] };
    GroundProblem::new(model, views, groups, found, knowledge, state)
}

/// Pose first, then pose and shape, to the minimum; returns the cost.
fn refine_car(problem: &mut GroundProblem<'_>, shape_fixed: bool, options: &SceneOptions) -> Option<f64> {
    problem.kernel = options.kernel;
    problem.shapes_fixed = true;
    problem.whiten(options.atlas_residual_scale, COARSE_SD_M);
    minimise(problem, &LmOptions { max_iterations: 8, cost_tolerance: 1e-3, ..options.lm });
    if !shape_fixed {
        approach(problem, options);
    }
    problem.shapes_fixed = shape_fixed;
    problem.whiten(options.atlas_residual_scale, 0.0);
    let report = minimise(problem, &options.lm);
    report.cost.is_finite().then_some(report.cost)
}
