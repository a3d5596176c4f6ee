//! From a start towards the minimum: shapes are freed in stages.

use crate::linear::lm::{LmOptions, minimise};
use crate::model::pose::Pose;
use crate::options::SceneOptions;
use crate::problem::cars::CarsProblem;

/// sd that shapes not yet found add to every keypoint, m: stage by stage less, so that the keypoints of an unusual car are
/// not taken for outliers before its shape had a chance (graduated non-convexity, Blake and Zisserman 1987).
/// The prior on shapes is eased with them, or it would hold the shapes back while keypoints count little: (sd, prior's factor).
const SHAPE_STAGES: [(f64, f64); 3] = [(0.12, 0.1), (0.05, 0.3), (0.02, 0.7)];

/// Shapes free; whitening from forgiving to exact, taken again at the new poses. Ends near the minimum, with its cost.
pub(crate) fn approach<P: Pose<N>, const N: usize, const M: usize>(
    problem: &mut CarsProblem<'_, P, N, M>,
    options: &SceneOptions,
) -> f64 {
    problem.shapes_fixed = false;
    let short = LmOptions { max_iterations: 6, cost_tolerance: 1e-2, step_tolerance: 1e-1, ..options.lm };
    for (extra_m, prior_scale) in &SHAPE_STAGES {
        problem.shape_prior_scale = *prior_scale;
        problem.whiten(options.atlas_residual_scale, *extra_m);
        minimise(problem, &short);
    }
    problem.shape_prior_scale = 1.0;
    problem.whiten(options.atlas_residual_scale, 0.0);
    let last = LmOptions { max_iterations: 12, cost_tolerance: 1e-3, step_tolerance: 1e-2, ..options.lm };
    minimise(problem, &last).cost
}
