//! Reclassification of single keypoints as inliers or outliers, to leave a poor local minimum.
//!
//! At such a minimum, a wrong keypoint may have distorted the car's shape until the keypoint fits. Or a right keypoint
//! may count as an outlier. So for every doubtful keypoint, the opposite class is tried.
//!
//! Let J and r be the Jacobian and the residual of the keypoint, both whitened, and C the covariance of the fit. If the
//! keypoint is removed or added, the minimum moves by δ to first order. The formulas are those of a Kalman filter, and
//! r̃ is the residual at the new minimum:
//!
//! ```text
//! removed   r̃ = (I − J C Jᵀ)⁻¹ r    δ =  C Jᵀ r̃
//! added     r̃ = (I + J C Jᵀ)⁻¹ r    δ = −C Jᵀ r̃
//! ```
//!
//! The cost then changes by about ½ (t² − r·r̃) for a removed keypoint, and by about ½ (r·r̃ − t²) for an added one.
//! The cost of an outlier is ½ t². If the predicted change is small enough, the cost is minimised again from the new
//! point. Source of r̃ for a removed keypoint: Cook and Weisberg, Residuals and Influence in Regression, §2.2.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2, Vector4};
use roadplane_base::MODES;

use crate::linear::gram::Gram;
use crate::linear::lm::{LmOptions, Problem as _, minimise};
use crate::model::latent::body_types::Gaussian;
use crate::model::on_plane::{ON_PLANE, PlanePose};
use crate::model::pose::Pose as _;
use crate::problem::cars::{CarsProblem, GroundProblem};
use crate::problem::setup::{PoseAndShape, Setup};

/// Number of unknowns of one car (pose and shape) for a fixed camera.
const OWN: usize = Gram::<ON_PLANE, MODES>::CAMERA;
/// Index of the residual's column in a row of the Jacobian.
const RESIDUAL: usize = Gram::<ON_PLANE, MODES>::RESIDUAL;
/// Largest predicted increase of the cost at which a keypoint's opposite class is tried.
const DOUBT: f64 = 8.0;
/// Number of keypoints tried per car and round; those with the largest predicted decrease of the cost come first.
const TRIES: usize = 8;
/// Largest number of rounds per car. Several rounds are needed, because one wrong keypoint may hide another.
const ROUNDS: usize = 3;
/// Smallest decrease of the cost that counts as an improvement.
const MIN_GAIN: f64 = 0.01;
/// Smallest determinant of the matrices I ∓ J C Jᵀ at which a keypoint is tried.
///
/// A smaller determinant means that this keypoint alone determines some direction of the unknowns.
const MIN_FREEDOM: f64 = 1e-3;

/// Returns a pose and shape of lower cost for the car in one view, if reclassified keypoints lead to such a fit.
///
/// The camera is fixed, and `place` is the present pose and shape.
pub(crate) fn reclassified(
    setup: &Setup<'_>,
    camera: &Vector4<f64>,
    usable_view: usize,
    place: PoseAndShape<PlanePose>,
) -> Option<PoseAndShape<PlanePose>> {
    let options = setup.options;
    let observations = &setup.usable_views[usable_view].observations;
    let prior = Gaussian::of_all_cars();
    let mut problem = CarsProblem::alone(setup.model, *camera, observations, prior, place, options.kernel);
    problem.whiten(options.atlas_residual_scale, 0.0);
    let before = minimise(&mut problem, &options.lm).cost;
    let mut lowest = (before, problem.pose_and_shape(0));
    for _ in 0..ROUNDS {
        let mut better = None;
        for start in starts(&mut problem)? {
            problem.set_pose_and_shape(start);
            let quick = LmOptions { initial_damping: 1e-2, ..options.lm };
            let cost = minimise(&mut problem, &quick).cost;
            if cost < better.map_or(lowest.0, |(cost, _)| cost) - MIN_GAIN {
                better = Some((cost, problem.pose_and_shape(0)));
            }
        }
        let Some((cost, place)) = better else { break };
        lowest = (cost, place);
        problem.set_pose_and_shape(place);
        problem.linearise()?;
    }
    (lowest.0 < before - MIN_GAIN).then_some(lowest.1)
}

/// Returns predicted poses and shapes, each with one doubtful keypoint removed or added.
///
/// The prediction with the lowest cost comes first.
fn starts(problem: &mut GroundProblem<'_, MODES>) -> Option<Vec<PoseAndShape<PlanePose>>> {
    let joint = problem.only_view_covariance()?;
    let own = joint.fixed_view::<OWN, OWN>(0, 0).into_owned();
    let wrong = problem.kernel.cost_of_wrong();
    let here = problem.pose_and_shape(0);
    let bounds = problem.model.bounds;
    let mut starts: Vec<(f64, PoseAndShape<PlanePose>)> = Vec::new();
    problem.each_row(0, |keypoint| {
        let j = SMatrix::<f64, 2, OWN>::from_fn(|r, c| keypoint.rows[r][c]);
        let r = Vector2::new(keypoint.rows[0][RESIDUAL], keypoint.rows[1][RESIDUAL]);
        let spread = own * j.transpose();
        let sign = if keypoint.right > 0.5 { -1.0 } else { 1.0 };
        let freedom = Matrix2::identity() + (j * spread) * sign;
        if freedom.determinant() < MIN_FREEDOM {
            return;
        }
        let Some(after) = freedom.try_inverse().map(|inverse| inverse * r) else { return };
        let change = 0.5 * sign * (r.dot(&after) - keypoint.weight * wrong);
        if change > DOUBT {
            return;
        }
        let step: SVector<f64, OWN> = spread * after * -sign;
        let mut start = here;
        start.pose = here.pose.moved(step.as_slice());
        for (m, [low, high]) in (0..MODES).zip(&bounds) {
            start.shape[m] = (start.shape[m] + step[ON_PLANE + m]).clamp(*low, *high);
        }
        starts.push((change, start));
    })?;
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.truncate(TRIES);
    Some(starts.into_iter().map(|(_, start)| start).collect())
}
