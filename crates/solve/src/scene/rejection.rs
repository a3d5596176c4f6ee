//! Rejection of false detections.

use roadplane_base::{MIN_KEYPOINTS, MODES};

use crate::options::SceneOptions;
use crate::problem::cars::GroundProblem;
use crate::problem::setup::cost_of_missing;

/// Whether view `k` shows a car on the ground plane of the problem's camera.
///
/// Enough keypoints must fit. The cost of keypoints and shape must also be well below the cost that the view has if all
/// its keypoints are outliers.
pub(crate) fn belongs(problem: &GroundProblem<'_, MODES>, k: usize, options: &SceneOptions) -> bool {
    let Some(fit) = problem.fit_of(k) else { return false };
    let group = problem.views[k].group;
    let cost = problem.groups[group].prior.cost(&problem.state.shapes[group]) + fit.cost;
    let count = fit.inliers.iter().filter(|inlier| **inlier).count();
    count >= options.min_inliers.min(MIN_KEYPOINTS + 1)
        && fit.right_weight >= options.min_inlier_share * fit.weight
        && cost <= options.max_cost_share * cost_of_missing(&options.kernel, fit.weight)
}
