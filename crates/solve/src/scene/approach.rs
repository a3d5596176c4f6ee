//! The descent from a start towards the minimum, in stages with free shapes and smaller and smaller keypoint sds.

use crate::linear::lm::{LmOptions, minimise};
use crate::model::pose::Pose;
use crate::options::SceneOptions;
use crate::problem::cars::CarsProblem;

/// Stages of the descent: the extra sd of every keypoint (m), and the weight of the shape prior.
///
/// The extra sd accounts for the unknown shape, and decreases from stage to stage. So keypoints of an unusual car do
/// not count as outliers before its shape is fitted (graduated non-convexity, Blake and Zisserman 1987). A large extra
/// sd also reduces the weight of the keypoints. So the shape prior gets a smaller weight in the early stages.
const SHAPE_STAGES: [(f64, f64); 3] = [(0.12, 0.1), (0.05, 0.3), (0.02, 0.7)];

/// Minimises the cost over camera, poses and shapes in stages, and returns the cost near the minimum.
///
/// Each stage first updates the whitening of the keypoints for the new poses.
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
