//! Whether what was called a car is one.

use roadplane_base::{MIN_KEYPOINTS, MODES};

use crate::options::SceneOptions;
use crate::problem::cars::GroundProblem;
use crate::problem::setup::cost_of_missing;

/// Whether a view is of a car on this plane: enough of its keypoints fit, and they fit well enough with a shape that is
/// likely enough to explain much more than "all keypoints are wrong" does.
pub(crate) fn belongs(problem: &GroundProblem<'_, MODES>, k: usize, options: &SceneOptions) -> bool {
    let Some(fit) = problem.fit_of(k) else { return false };
    let group = problem.views[k].group;
    let cost = problem.groups[group].prior.cost(&problem.state.shapes[group]) + fit.cost;
    let count = fit.inliers.iter().filter(|inlier| **inlier).count();
    count >= options.min_inliers.min(MIN_KEYPOINTS + 1)
        && fit.right_weight >= options.min_inlier_share * fit.weight
        && cost <= options.max_cost_share * cost_of_missing(&options.kernel, fit.weight)
}
