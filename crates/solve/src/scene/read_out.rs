//! From the minimum to the answer: the camera of all modes, its covariance, and the cars before it.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::CameraParams;

use crate::linear::lm::{LmReport, Termination, minimise};
use crate::options::ShapePrior;
use crate::problem::ground::{Covariances, GroundProblem};
use crate::problem::setup::Setup;
use crate::scene::all_modes::camera_of_all_modes;
use crate::scene::car::car_solution;
use crate::scene::fit::fit_car;
use crate::scene::marginal;
use crate::solution::{CarSolution, CarView, SceneSolution, SceneStatus};

/// A data-only sd of log focal above this says that the cars do not know the focal length.
const FOCAL_UNKNOWN_SD: f64 = 0.3;

/// The answer of a problem at its minimum, whose views are the sights `members`; other sights are fitted before the camera found.
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
        if let Some(fine) = camera_of_all_modes(setup.atlas, problem, options) {
            (camera_information, covariance) = (fine.information, fine.covariance);
            problem.follow(&(fine.camera - problem.state.camera));
            // Too far a way for the cars to follow exactly.
            problem.knowledge.fixed = [true; 4];
            minimise(problem, &options.lm);
            if problem.covariances().is_none() {
                return unsolved(setup, views.len(), SceneStatus::Failed);
            }
        } else if options.steps.marginal
            && let Some(change) = marginal::change(problem, &covariance)
        {
            problem.follow(&change);
        }
    }
    let data_focal_information = 1.0 / covariance[(0, 0)] - setup.knowledge.information[0];
    let dispersed = camera_information / options.camera_dispersion;
    let Some(covariance) = setup.knowledge.covariance(&dispersed, &problem.state.camera) else {
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
    let pull = setup.knowledge.terms(&problem.state.camera).gradient;
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
pub(crate) fn unsolved(setup: &Setup<'_>, views: usize, status: SceneStatus) -> SceneSolution {
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
