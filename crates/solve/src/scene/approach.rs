//! The descent from a start towards the minimum, with shapes freed in stages.

use crate::linear::lm::{LmOptions, minimise};
use crate::model::pose::Pose;
use crate::options::SceneOptions;
use crate::problem::cars::CarsProblem;

/// Stages of the descent: extra sd of every keypoint (m) and factor on the shape prior.
///
/// The extra sd allows for the unknown shape, and falls from stage to stage. So keypoints of an unusual car do not
/// count as outliers before its shape is fitted (graduated non-convexity, Blake and Zisserman 1987). The shape prior is
/// weaker in early stages, because there keypoints have little weight against it.
const SHAPE_STAGES: [(f64, f64); 3] = [(0.12, 0.1), (0.05, 0.3), (0.02, 0.7)];

/// Minimises with free shapes in stages, and whitens again at the new poses before each stage.
///
/// Ends near the minimum and returns its cost.
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
