//! Whether what was called a car is one.

use roadplane_base::MIN_KEYPOINTS;

use crate::options::SceneOptions;
use crate::problem::ground::GroundProblem;
use crate::problem::setup::cost_of_missing;

/// Whether a view is of a car on this plane: enough of its keypoints fit, and they fit well enough with a shape that is
/// likely enough to explain much more than "all keypoints are wrong" does.
pub(crate) fn belongs(problem: &GroundProblem<'_>, k: usize, options: &SceneOptions) -> bool {
    let (mut right, mut all, mut count) = (0.0, 0.0, 0);
    let group = problem.views[k].group;
    let mut cost = problem.groups[group].prior.cost(&problem.state.shapes[group]);
    let seen = problem.each_residual(k, |observation, _, squared| {
        let probability = options.kernel.weight(squared);
        right += observation.weight * probability;
        all += observation.weight;
        count += usize::from(probability > 0.5);
        cost += 0.5 * observation.weight * options.kernel.cost(squared);
    });
    seen.is_some()
        && count >= options.min_inliers.min(MIN_KEYPOINTS + 1)
        && right >= options.min_inlier_share * all
        && cost <= options.max_cost_share * cost_of_missing(&options.kernel, all)
}
