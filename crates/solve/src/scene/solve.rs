//! The complete solve of one frame, in seven steps:
//!
//! 1. Use the given start of the camera, or search for starts (`start/cold_start.rs`).
//! 2. Minimise the cost in stages from each start, and continue with the result of lowest cost (`approach.rs`).
//! 3. Reject views that do not fit a car, and minimise with the remaining views (`rejection.rs`).
//! 4. Minimise until convergence.
//! 5. Try the opposite class (inlier or outlier) for doubtful keypoints (`reclassify.rs`).
//! 6. Refine the camera with all modes of the shape atlas (`all_modes.rs`), and correct its bias
//!    (`problem/cars/bias.rs`).
//! 7. Compute covariances, and the cars' poses and shapes for the final camera (`read_out.rs`).
//!
//! [`Steps`](crate::Steps) can switch steps off. `roadplane-lab eval solver --layers` measures the effects of the
//! steps.

use roadplane_base::{CameraParams, ImageSize, MODES, ShapeAtlas};

use crate::linear::lm::{LmReport, minimise};
use crate::model::points::PointModes;
use crate::options::SceneOptions;
use crate::problem::cars::GroundProblem;
use crate::problem::setup::Setup;
use crate::scene::approach::approach;
use crate::scene::read_out::{read_out, unsolved};
use crate::scene::reclassify::reclassified;
use crate::scene::rejection::belongs;
use crate::solution::{CarView, SceneSolution, SceneStatus};
use crate::start::cold_start::{Start, coarse, cold_starts, place_all};

/// Number of starts from the search that are refined with free shapes.
const FINALISTS: usize = 3;
/// Largest number of rounds that reject views.
const REJECTION_ROUNDS: usize = 3;
/// Largest number of rounds that reclassify keypoints; each round goes through all cars.
const RECLASSIFY_ROUNDS: usize = 4;
/// Largest cost per keypoint at which a given start is used without a search.
const GOOD_COST_PER_KEYPOINT: f64 = 2.0;
/// Largest distance of the solution from a given start, in (log focal length, tilt, roll, log height).
///
/// If the distance is larger, the solver searches for other starts.
const WARM_REACH: [f64; 4] = [0.3, 0.1, 0.1, 0.3];

/// Estimates focal length, ground plane, and the poses and shapes of all cars of one frame.
///
/// The function never panics or hangs. If a frame cannot be solved, the status gives the reason, and the covariance is
/// that of the prior.
#[must_use]
pub fn solve_scene(
    atlas: &ShapeAtlas,
    size: ImageSize,
    views: &[CarView<'_>],
    options: &SceneOptions,
) -> SceneSolution {
    let model = PointModes::new(atlas);
    let setup = Setup::new(atlas, &model, size, views, options);
    if setup.usable_views.is_empty() {
        return unsolved(&setup, views.len(), SceneStatus::TooFewCars);
    }
    if let (Some(given), Some(start)) =
        (options.start, warm_start(&setup).and_then(|start| best_of(&setup, vec![start])))
    {
        let found = finish(&setup, start, views);
        let moved = (found.params.to_vector() - given.to_vector()).abs();
        if found.status.usable() && (0..4).all(|i| moved[i] < WARM_REACH[i]) {
            return found;
        }
    }
    let Some(start) = best_of(&setup, cold_starts(&setup, FINALISTS)) else {
        return unsolved(&setup, views.len(), SceneStatus::Failed);
    };
    finish(&setup, start, views)
}

/// Minimises the cost from each start, with free shapes, and returns the result of lowest cost.
///
/// All keypoints of a car without a pose count as outliers.
fn best_of(setup: &Setup<'_>, starts: Vec<Start>) -> Option<Start> {
    let mut best: Option<Start> = None;
    for start in starts {
        let (mut problem, members) = setup.problem(start.camera, &start.placed);
        let cost = approach(&mut problem, setup.options) + setup.cost_of_missing(&start.placed);
        if cost.is_finite() && best.as_ref().is_none_or(|best| cost < best.cost) {
            let placed = setup.read_back(&problem, &members);
            best = Some(Start { cost, camera: problem.state.camera, placed });
        }
    }
    best
}

/// Returns the caller's start after a short refinement, or `None` if the cars do not fit it.
fn warm_start(setup: &Setup<'_>) -> Option<Start> {
    let mut camera = setup.options.start.map(CameraParams::to_vector)?;
    if !camera.iter().all(|v| v.is_finite()) {
        return None;
    }
    if setup.knowledge.fixed[0] {
        camera[0] = setup.knowledge.mean[0];
    }
    let keypoints: usize = setup.usable_views.iter().map(|usable_view| usable_view.observations.len()).sum();
    let start = coarse(setup, place_all(setup, &camera))?;
    (start.cost < GOOD_COST_PER_KEYPOINT * keypoints as f64).then_some(start)
}

/// Minimises the cost with free shapes until convergence.
fn polish(problem: &mut GroundProblem<'_, MODES>, options: &SceneOptions) -> LmReport {
    problem.shapes_fixed = false;
    problem.whiten(options.atlas_residual_scale, 0.0);
    minimise(problem, &options.lm)
}

/// Completes the solve from a start: rejects false detections, minimises the cost and returns the solution.
fn finish(setup: &Setup<'_>, start: Start, views: &[CarView<'_>]) -> SceneSolution {
    let options = setup.options;
    let mut camera = start.camera;
    let mut chosen = start.placed.clone();
    let mut placed = start.placed;
    let rounds = if options.steps.rejection { REJECTION_ROUNDS } else { 0 };
    for _ in 0..rounds {
        let (mut problem, members) = setup.problem(camera, &placed);
        problem.whiten(options.atlas_residual_scale, 0.0);
        let mut belong = vec![None; placed.len()];
        for (k, s) in members.iter().enumerate() {
            belong[*s] = placed[*s].filter(|_| belongs(&problem, k, options));
        }
        let same = belong.iter().zip(&chosen).all(|(a, b)| a.is_some() == b.is_some());
        if same || belong.iter().all(Option::is_none) {
            break;
        }
        let (mut problem, members) = setup.problem(camera, &belong);
        approach(&mut problem, options);
        camera = problem.state.camera;
        chosen = setup.read_back(&problem, &members);
        for (place, found) in placed.iter_mut().zip(&chosen) {
            *place = found.or(*place);
        }
    }
    let (mut problem, members) = setup.problem(camera, &chosen);
    let mut report = polish(&mut problem, options);
    let rounds = if options.steps.reclassify { RECLASSIFY_ROUNDS } else { 0 };
    for _ in 0..rounds {
        let camera = problem.state.camera;
        let mut changed = setup.read_back(&problem, &members);
        let mut any = false;
        for s in &members {
            let better = changed[*s].and_then(|place| reclassified(setup, &camera, *s, place));
            any |= better.is_some();
            changed[*s] = better.or(changed[*s]);
        }
        if !any {
            break;
        }
        let (mut other, _) = setup.problem(camera, &changed);
        let polished = polish(&mut other, options);
        if polished.cost >= report.cost {
            break;
        }
        (problem, report) = (other, polished);
    }
    read_out(setup, &mut problem, &members, &report, views)
}
