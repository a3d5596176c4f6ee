//! The whole solve of one frame, top to bottom.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, ImageSize, ShapeAtlas};

use crate::cold_start::{Start, coarse, cold_starts, place_all};
use crate::fine;
use crate::fit::{car_solution, fit_car};
use crate::ground_problem::{Covariances, GroundProblem};
use crate::ground_residual::PointModes;
use crate::lm::{LmOptions, LmReport, Termination, minimise};
use crate::marginal;
use crate::options::{SceneOptions, ShapePrior};
use crate::reclassify::reclassified;
use crate::repair::{belongs, repair};
use crate::setup::{Placed, Setup};
use crate::solution::{CarSolution, CarView, SceneSolution, SceneStatus};

/// Starts that are refined with shapes.
const FINALISTS: usize = 3;
/// Rounds of "is another heading better?" and "does this car belong?".
const REPAIR_ROUNDS: usize = 3;
/// Rounds of changing one's mind about single keypoints, all cars at once.
const RECLASSIFY_ROUNDS: usize = 4;
/// A start nearer than this in cost per keypoint is as good as found (warm starts).
const GOOD_COST_PER_KEYPOINT: f64 = 2.0;
/// A start that the cars lead further away from (log focal, tilt, roll, log height) was none: the search decides.
const WARM_REACH: [f64; 4] = [0.3, 0.1, 0.1, 0.3];
/// A data-only sd of log focal above this says that the cars do not know the focal length.
const FOCAL_UNKNOWN_SD: f64 = 0.3;

/// Solves a frame for focal length, plane, poses and shapes. Never panics or hangs: what cannot be solved has a status that
/// says so, and uncertainty that is as wide as it is.
#[must_use]
pub fn solve_scene(
    atlas: &ShapeAtlas,
    size: ImageSize,
    views: &[CarView<'_>],
    options: &SceneOptions,
) -> SceneSolution {
    let model = PointModes::new(atlas);
    let mut setup = Setup::new(atlas, &model, size, views, options);
    if setup.sights.is_empty() {
        return unsolved(&setup, views.len(), SceneStatus::TooFewCars);
    }
    if let (Some(given), Some(start)) =
        (options.start, warm_start(&setup).and_then(|start| best_of(&setup, vec![start])))
    {
        let found = finish(&mut setup, start, views);
        let moved = (found.params.to_vector() - given.to_vector()).abs();
        if found.status.usable() && (0..4).all(|i| moved[i] < WARM_REACH[i]) {
            return found;
        }
        // What was believed of the cars before the wrong camera goes with it.
        setup = Setup::new(atlas, &model, size, views, options);
    }
    let Some(start) = best_of(&setup, cold_starts(&setup, FINALISTS)) else {
        return unsolved(&setup, views.len(), SceneStatus::Failed);
    };
    finish(&mut setup, start, views)
}

/// The start that leads to the lowest cost with shapes free, followed there. Cars without a place cost what they cost as
/// outliers.
fn best_of(setup: &Setup<'_>, starts: Vec<Start>) -> Option<Start> {
    let mut best: Option<Start> = None;
    for start in starts {
        let (mut problem, members) = setup.problem(start.camera, &start.placed);
        approach(&mut problem, setup.options);
        let missing: f64 = (0..setup.sights.len())
            .filter(|s| start.placed[*s].is_none())
            .map(|s| setup.cost_of_missing(s))
            .sum();
        let cost = problem.current_cost().unwrap_or(f64::INFINITY) + missing;
        if cost.is_finite() && best.as_ref().is_none_or(|best| cost < best.cost) {
            let placed = setup.read_back(&problem, &members);
            best = Some(Start { cost, camera: problem.state.camera, placed });
        }
    }
    best
}

/// The start that the caller gives, if the cars fit there.
fn warm_start(setup: &Setup<'_>) -> Option<Start> {
    let mut camera = setup.options.start.map(CameraParams::to_vector)?;
    if !camera.iter().all(|v| v.is_finite()) {
        return None;
    }
    if setup.knowledge.fixed[0] {
        camera[0] = setup.knowledge.mean[0];
    }
    let keypoints: usize = setup.sights.iter().map(|sight| sight.observations.len()).sum();
    let start = coarse(setup, place_all(setup, &camera))?;
    (start.cost < GOOD_COST_PER_KEYPOINT * keypoints as f64).then_some(start)
}

/// sd that shapes not yet found add to every keypoint, m: stage by stage less, so that the keypoints of an unusual car are
/// not taken for outliers before its shape had a chance (graduated non-convexity, Blake and Zisserman 1987).
/// The prior on shapes is eased with them, or it would hold the shapes back while keypoints count little: (sd, prior's factor).
pub(crate) const SHAPE_STAGES: [(f64, f64); 3] = [(0.12, 0.1), (0.05, 0.3), (0.02, 0.7)];

/// Another path for cars that the first one left with keypoints to spare: wider and more gradual.
pub(crate) const SLOW_STAGES: [(f64, f64); 5] =
    [(0.3, 0.02), (0.2, 0.05), (0.1, 0.2), (0.05, 0.5), (0.02, 0.8)];

/// Shapes free; whitening from forgiving to exact, taken again at the new poses. Ends near the minimum.
pub(crate) fn approach(problem: &mut GroundProblem<'_>, options: &SceneOptions) {
    approach_by(problem, options, &SHAPE_STAGES);
}

/// The same by other stages.
pub(crate) fn approach_by(problem: &mut GroundProblem<'_>, options: &SceneOptions, stages: &[(f64, f64)]) {
    problem.shapes_fixed = false;
    let short = LmOptions { max_iterations: 6, cost_tolerance: 1e-2, step_tolerance: 1e-1, ..options.lm };
    for (extra_m, prior_scale) in stages {
        problem.shape_prior_scale = *prior_scale;
        problem.whiten(options.atlas_residual_scale, *extra_m);
        minimise(problem, &short);
    }
    problem.shape_prior_scale = 1.0;
    problem.whiten(options.atlas_residual_scale, 0.0);
    minimise(
        problem,
        &LmOptions { max_iterations: 12, cost_tolerance: 1e-3, step_tolerance: 1e-2, ..options.lm },
    );
}

/// To the minimum.
fn polish(problem: &mut GroundProblem<'_>, options: &SceneOptions) -> LmReport {
    problem.shapes_fixed = false;
    problem.whiten(options.atlas_residual_scale, 0.0);
    minimise(problem, &options.lm)
}

/// Repairs headings, leaves out wholly wrong cars, refines to the end, reads out.
fn finish(setup: &mut Setup<'_>, start: Start, views: &[CarView<'_>]) -> SceneSolution {
    let options = setup.options;
    let mut camera = start.camera;
    let mut placed = start.placed;
    let mut used: Vec<bool> = placed.iter().map(Option::is_some).collect();
    for _ in 0..REPAIR_ROUNDS {
        let repaired = repair(setup, &camera, &mut placed);
        let (mut problem, members) = setup.problem(camera, &placed);
        problem.whiten(options.atlas_residual_scale, 0.0);
        let mut belong = vec![false; placed.len()];
        for (k, s) in members.iter().enumerate() {
            belong[*s] = belongs(&problem, k, options);
        }
        if !belong.contains(&true) {
            belong.clone_from(&used);
        }
        if !repaired && belong == used {
            break;
        }
        used.clone_from(&belong);
        let chosen: Vec<Option<Placed>> = placed.iter().zip(&used).map(|(p, u)| p.filter(|_| *u)).collect();
        let (mut problem, members) = setup.problem(camera, &chosen);
        approach(&mut problem, options);
        camera = problem.state.camera;
        for (s, place) in setup.read_back(&problem, &members).into_iter().enumerate() {
            placed[s] = place.or(placed[s]);
        }
    }
    let chosen: Vec<Option<Placed>> = placed.iter().zip(&used).map(|(p, u)| p.filter(|_| *u)).collect();
    let (mut problem, members) = setup.problem(camera, &chosen);
    let mut report = polish(&mut problem, options);
    for _ in 0..RECLASSIFY_ROUNDS {
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

pub(crate) fn read_out(
    setup: &Setup<'_>,
    problem: &mut GroundProblem<'_>,
    members: &[usize],
    report: &LmReport,
    views: &[CarView<'_>],
) -> SceneSolution {
    let options = setup.options;
    let Some(Covariances { mut camera_information, camera: mut covariance }) = problem.covariances() else {
        return unsolved(setup, views.len(), SceneStatus::Failed);
    };
    if report.iterations > 0 {
        if let Some(fine) = fine::camera_of_all_modes(setup.atlas, problem, options) {
            (camera_information, covariance) = (fine.information, fine.covariance);
            problem.follow(&(fine.camera - problem.state.camera));
            // Too far a way for the cars to follow exactly.
            problem.knowledge.fixed = [true; 4];
            minimise(problem, &options.lm);
            if problem.covariances().is_none() {
                return unsolved(setup, views.len(), SceneStatus::Failed);
            }
        } else if options.marginal
            && let Some(change) = marginal::change(problem, &covariance)
        {
            problem.follow(&change);
        }
    }
    let data_focal_information = 1.0 / covariance[(0, 0)] - setup.knowledge.information[0];
    let dispersed = camera_information / options.camera_dispersion;
    let Some(covariance) = setup.knowledge.covariance(&dispersed) else {
        return unsolved(setup, views.len(), SceneStatus::Failed);
    };
    let joints = problem.view_covariances(&covariance);
    let params = CameraParams::from_vector(&problem.state.camera);
    let mut cars: Vec<Option<CarSolution>> = vec![None; views.len()];
    for (k, s) in members.iter().enumerate() {
        let solved = car_solution(problem, k, &joints[k]);
        cars[setup.sights[*s].index] = solved.map(|(car, _)| car);
    }
    let camera = roadplane_base::Camera::centred(params.focal_px(), setup.size);
    for (s, sight) in setup.sights.iter().enumerate() {
        if members.binary_search(&s).is_err() {
            let keypoints = views[sight.index].keypoints;
            let fit = fit_car(
                setup.atlas,
                &camera,
                &params.plane(),
                keypoints,
                &ShapePrior::default(),
                None,
                options,
            );
            cars[sight.index] = fit.map(|fit| CarSolution { used: false, ..fit.car });
        }
    }
    let pull = (problem.state.camera - setup.knowledge.mean).component_mul(&setup.knowledge.information);
    let status = if !(report.termination.converged() || report.termination == Termination::NoDescent) {
        SceneStatus::NotConverged
    } else if setup.knowledge.fixed[0] {
        SceneStatus::FocalGiven
    } else if data_focal_information < 1.0 / (FOCAL_UNKNOWN_SD * FOCAL_UNKNOWN_SD) {
        SceneStatus::FocalFromPrior
    } else {
        SceneStatus::Converged
    };
    SceneSolution {
        status,
        params,
        information: camera_information,
        information_vector: camera_information * problem.state.camera + pull,
        covariance,
        cars,
        cost: report.cost,
        iterations: report.iterations,
        termination: report.termination,
    }
}

/// The prior, as an answer.
fn unsolved(setup: &Setup<'_>, views: usize, status: SceneStatus) -> SceneSolution {
    let variance = |information: f64, fixed: bool| match fixed {
        true => 0.0,
        false => 1.0 / information,
    };
    let knowledge = &setup.knowledge;
    SceneSolution {
        status,
        params: CameraParams::from_vector(&knowledge.mean),
        information: Matrix4::zeros(),
        information_vector: Vector4::zeros(),
        covariance: Matrix4::from_diagonal(&Vector4::from_fn(|i, _| {
            variance(knowledge.information[i], knowledge.fixed[i])
        })),
        cars: vec![None; views],
        cost: f64::INFINITY,
        iterations: 0,
        termination: Termination::Failed,
    }
}
