//! The whole solve of one frame, from top to bottom:
//!
//! 1. starts: the given one, or a search from nothing (`start/cold_start.rs`);
//! 2. minimisation from each start with free shapes, in stages (`approach.rs`); the lowest cost is kept;
//! 3. rejection of views that do not fit a car, and minimisation with the others (`rejection.rs`);
//! 4. the minimum;
//! 5. reclassification of single keypoints (`reclassify.rs`);
//! 6. the camera of all modes, with body types and trust (`all_modes.rs`) and corrected bias (`problem/cars/bias.rs`);
//! 7. covariances, and the cars before that camera (`read_out.rs`).
//!
//! [`Steps`](crate::Steps) switches steps off, to measure their effects (`roadplane-lab eval solver --layers`).

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

/// Number of starts that are refined with shapes.
const FINALISTS: usize = 3;
/// Largest number of rounds of rejection.
const REJECTION_ROUNDS: usize = 3;
/// Largest number of rounds of reclassification of keypoints, over all cars.
const RECLASSIFY_ROUNDS: usize = 4;
/// Largest cost per keypoint at which a given start is used without a search.
const GOOD_COST_PER_KEYPOINT: f64 = 2.0;
/// Largest change of (log focal, tilt, roll, log height) from a given start; beyond it, the search decides.
const WARM_REACH: [f64; 4] = [0.3, 0.1, 0.1, 0.3];

/// Solves a frame for focal length, plane, poses and shapes.
///
/// It never panics or hangs. The status names the reason if a frame cannot be solved, and the covariance is then as
/// wide as the prior's.
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

/// Minimises from each start with free shapes, and returns the state of lowest cost.
///
/// A car without a pose costs as much as outliers only.
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

/// Returns the start that the caller gives, if the cars fit there.
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

/// Minimises with free shapes.
fn polish(problem: &mut GroundProblem<'_, MODES>, options: &SceneOptions) -> LmReport {
    problem.shapes_fixed = false;
    problem.whiten(options.atlas_residual_scale, 0.0);
    minimise(problem, &options.lm)
}

/// Rejects false detections, refines to the minimum and returns the solution.
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
