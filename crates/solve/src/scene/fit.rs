//! The fit of one car's pose and shape, for a given camera and ground plane.

use nalgebra::{Matrix6, SMatrix, Vector4};
use roadplane_base::{Camera, CameraParams, GroundPlane, GroundPose, KeypointSet, MODES, ShapeAtlas};

use crate::linear::lm::{LmOptions, minimise};
use crate::model::latent::body_types::Gaussian;
use crate::model::observation::{Observation, observations};
use crate::model::on_plane::PlanePose;
use crate::model::points::PointModes;
use crate::model::pose::{CameraFrame, Pose};
use crate::options::{SceneOptions, ShapePrior};
use crate::problem::cars::{CarsProblem, GroundProblem};
use crate::problem::setup::PoseAndShape;
use crate::scene::approach::approach;
use crate::scene::car::car_solution;
use crate::solution::CarSolution;
use crate::start::cold_start::COARSE_SD_M;
use crate::start::on_plane::plane_pose_candidates;

/// Number of candidate headings that are used as starts of the descent.
const FOLLOWED: usize = 4;

/// The fit of one car for a given camera and ground plane.
#[derive(Clone, Debug)]
pub struct CarFit {
    /// Pose, shape and inliers. The covariances treat camera and plane as exact.
    pub car: CarSolution,
    /// Joint covariance of (x m, y m, heading rad, the six shape coefficients).
    pub covariance: SMatrix<f64, 9, 9>,
    /// Cost at the minimum: keypoints and shape prior.
    pub cost: f64,
    /// Cost of the best fit with another heading (more than 0.5 rad away), minus `cost`.
    ///
    /// The difference is infinite if there is no such fit. If it is less than about 5, the heading is a guess.
    pub margin: f64,
}

/// Fits pose and shape of one car to its keypoints, for a given camera and ground plane.
///
/// Headings all around the circle are tried even if a `start` is given. So the keypoints always decide between front
/// and back. Returns `None` if fewer than [`MIN_KEYPOINTS`](roadplane_base::MIN_KEYPOINTS) keypoints are usable, if no
/// pose can be evaluated, or if camera or plane are not finite.
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
    let found = observations(keypoints, camera, 1.0)?;
    let frame = CameraFrame::new(&params);
    let points = atlas.keypoints_in_car(&shape.mean);
    let candidates = plane_pose_candidates(&frame, &points, &found, FOLLOWED);
    let given = start.and_then(|pose| PlanePose::of(pose, &frame));
    let starts = candidates.into_iter().map(|(_, plane_pose)| plane_pose).chain(given);
    let mut fits = fits_from(&model, params, &found, shape, starts, options);
    let (cost, mut problem) = if fits.is_empty() { return None } else { fits.remove(0) };
    let heading = problem.state.poses[0].heading;
    let elsewhere = |other: &GroundProblem<'_, MODES>| {
        roadplane_base::angle_difference(other.state.poses[0].heading, heading).abs() > 0.5
    };
    let margin = fits.iter().find(|(_, p)| elsewhere(p)).map_or(f64::INFINITY, |(other, _)| other - cost);
    problem.shapes_fixed = false;
    let joint = problem.only_view_covariance()?;
    let (mut car, mut covariance) = car_solution(&problem, 0, &joint)?;
    if shape.fixed {
        covariance = with_shape(&covariance, &shape.information)?;
        car.ground_covariance = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        car.shape_covariance = covariance.fixed_view::<MODES, MODES>(3, 3).into_owned();
    }
    let right = car.inliers.iter().filter(|inlier| **inlier).count();
    car.used = right >= options.min_inliers && right as f64 >= options.min_inlier_share * found.len() as f64;
    Some(CarFit { car, covariance, cost, margin })
}

/// Returns the joint covariance of (x, y, heading, shape) if the shape has this information instead of its own.
///
/// The pose follows the shape linearly, with the derivative D = Σ_ps Σ_ss⁻¹. So its covariance is that for a given shape,
/// plus D Λ⁻¹ Dᵀ.
fn with_shape(joint: &SMatrix<f64, 9, 9>, information: &Matrix6<f64>) -> Option<SMatrix<f64, 9, 9>> {
    let shape = information.cholesky()?.inverse();
    let between = joint.fixed_view::<3, MODES>(0, 3).into_owned();
    // A coefficient at its bound does not change: its rows are zero.
    let own = joint.fixed_view::<MODES, MODES>(3, 3) + Matrix6::identity() * 1e-12;
    let by_shape = between * own.cholesky()?.inverse();
    let given_shape = joint.fixed_view::<3, 3>(0, 0) - by_shape * between.transpose();
    let mut whole = SMatrix::<f64, 9, 9>::zeros();
    whole.fixed_view_mut::<3, 3>(0, 0).copy_from(&(given_shape + by_shape * shape * by_shape.transpose()));
    whole.fixed_view_mut::<3, MODES>(0, 3).copy_from(&(by_shape * shape));
    whole.fixed_view_mut::<MODES, 3>(3, 0).copy_from(&(by_shape * shape).transpose());
    whole.fixed_view_mut::<MODES, MODES>(3, 3).copy_from(&shape);
    Some(whole)
}

/// Fits one car for a given camera from each start: first its pose, then pose and shape.
///
/// Returns one fitted problem per start, with its cost at the minimum that was reached. The lowest cost comes first.
/// Starts that cannot be evaluated are left out.
pub(crate) fn fits_from<'a, P: Pose<N>, const N: usize>(
    model: &'a PointModes,
    camera: Vector4<f64>,
    found: &[Observation],
    shape: &ShapePrior,
    starts: impl Iterator<Item = P>,
    options: &SceneOptions,
) -> Vec<(f64, CarsProblem<'a, P, N, MODES>)> {
    let fit = |pose: P| {
        let prior = Gaussian { mean: shape.mean, information: shape.information };
        let place = PoseAndShape { pose, shape: shape.mean };
        let mut problem = CarsProblem::alone(model, camera, found, prior, place, options.kernel);
        problem.shapes_fixed = true;
        problem.whiten(options.atlas_residual_scale, COARSE_SD_M);
        minimise(&mut problem, &LmOptions { max_iterations: 8, cost_tolerance: 1e-3, ..options.lm });
        if !shape.fixed {
            approach(&mut problem, options);
        }
        problem.whiten(options.atlas_residual_scale, 0.0);
        let cost = minimise(&mut problem, &options.lm).cost;
        cost.is_finite().then_some((cost, problem))
    };
    let mut fits: Vec<_> = starts.filter_map(fit).collect();
    fits.sort_by(|a, b| a.0.total_cmp(&b.0));
    fits
}
