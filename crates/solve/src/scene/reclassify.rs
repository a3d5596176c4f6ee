//! Which keypoints are right? A minimum where one wrong keypoint has bent the shape to itself (or a right one is left out) is
//! left by asking for every doubtful keypoint what the fit would be with the opposite answer.
//!
//! With rows J and residual r of the keypoint and the fit's covariance C, taking it out (or in) moves the minimum, to first
//! order, by the down- (or up-)date of a Kalman filter, and its residual becomes
//!
//! ```text
//! out   δ =  C Jᵀ r̃    r̃ = (I − J C Jᵀ)⁻¹ r      in   δ = −C Jᵀ r̃    r̃ = (I + J C Jᵀ)⁻¹ r
//! ```
//!
//! The cost then changes by about ½ (t² − r·r̃), or its opposite. Where that is not hopeless the fit is minimised from there.
//! Source of the deleted residual: Cook and Weisberg, Residuals and Influence in Regression, §2.2.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2, Vector4};
use roadplane_base::MODES;

use crate::linear::gram::Gram;
use crate::linear::lm::{LmOptions, Problem as _, minimise};
use crate::model::latent::body_types::Gaussian;
use crate::model::pose::Pose as _;
use crate::model::standing::{STANDING, Standing};
use crate::problem::cars::{CarsProblem, GroundProblem};
use crate::problem::setup::{Placed, Setup};

/// Unknowns of a car before a given camera.
const OWN: usize = Gram::<STANDING, MODES>::CAMERA;
/// Column of the residual.
const RESIDUAL: usize = Gram::<STANDING, MODES>::RESIDUAL;
/// A change that promises to cost more than this is not tried.
const DOUBT: f64 = 8.0;
/// Tried per car and round, the most promising first.
const TRIES: usize = 8;
/// Rounds per car: one keypoint may hide another.
const ROUNDS: usize = 3;
/// Decrease of the cost that counts.
const MIN_GAIN: f64 = 0.01;
/// A keypoint that alone determines a direction cannot be questioned.
const MIN_FREEDOM: f64 = 1e-3;

/// A better place and shape of a sight before this camera, if changing one's mind about single keypoints finds one.
pub(crate) fn reclassified(
    setup: &Setup<'_>,
    camera: &Vector4<f64>,
    sight: usize,
    place: Placed<Standing>,
) -> Option<Placed<Standing>> {
    let options = setup.options;
    let observations = &setup.sights[sight].observations;
    let prior = Gaussian::of_all_cars();
    let mut problem = CarsProblem::alone(setup.model, *camera, observations, prior, place, options.kernel);
    problem.whiten(options.atlas_residual_scale, 0.0);
    let before = minimise(&mut problem, &options.lm).cost;
    let mut lowest = (before, problem.placed(0));
    for _ in 0..ROUNDS {
        let mut better = None;
        for start in starts(&mut problem)? {
            problem.place(start);
            let quick = LmOptions { initial_damping: 1e-2, ..options.lm };
            let cost = minimise(&mut problem, &quick).cost;
            if cost < better.map_or(lowest.0, |(cost, _)| cost) - MIN_GAIN {
                better = Some((cost, problem.placed(0)));
            }
        }
        let Some((cost, place)) = better else { break };
        lowest = (cost, place);
        problem.place(place);
        problem.linearise()?;
    }
    (lowest.0 < before - MIN_GAIN).then_some(lowest.1)
}

/// Where the fit would be with one doubtful keypoint taken out or in, most promising first.
fn starts(problem: &mut GroundProblem<'_, MODES>) -> Option<Vec<Placed<Standing>>> {
    let joint = problem.only_view_covariance()?;
    let own = joint.fixed_view::<OWN, OWN>(0, 0).into_owned();
    let wrong = problem.kernel.cost_of_wrong();
    let here = problem.placed(0);
    let bounds = problem.model.bounds;
    let mut starts: Vec<(f64, Placed<Standing>)> = Vec::new();
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
            start.shape[m] = (start.shape[m] + step[STANDING + m]).clamp(*low, *high);
        }
        starts.push((change, start));
    })?;
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.truncate(TRIES);
    Some(starts.into_iter().map(|(_, start)| start).collect())
}
