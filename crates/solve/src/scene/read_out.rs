//! The solution at the minimum: the camera refined with all modes, its covariance, and the cars' poses and shapes.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{Camera, CameraParams, JointInformation, MODES};

use crate::linear::lm::{LmReport, Termination, minimise};
use crate::options::ShapePrior;
use crate::problem::cars::GroundProblem;
use crate::problem::setup::Setup;
use crate::scene::all_modes::{FineCamera, camera_of_all_modes, camera_of_cars};
use crate::scene::car::car_solution;
use crate::scene::fit::fit_car;
use crate::solution::{CarSolution, CarView, SceneSolution, SceneStatus};

/// Returns the solution of a problem that is at its minimum.
///
/// `members` lists the problem's views by their index in `setup.usable_views`. Usable views outside the problem are
/// fitted one by one to the estimated camera, which stays fixed.
pub(crate) fn read_out(
    setup: &Setup<'_>,
    problem: &mut GroundProblem<'_, MODES>,
    members: &[usize],
    report: &LmReport,
    views: &[CarView<'_>],
) -> SceneSolution {
    let options = setup.options;
    let failed = || unsolved(setup, views.len(), SceneStatus::Failed);
    if problem.information().is_none() {
        return failed();
    }
    let is_followed = report.iterations > 0;
    let fine = is_followed.then(|| camera_of_all_modes(setup.atlas, problem, options)).flatten();
    let is_fine = fine.is_some();
    let Some(answer) = fine.or_else(|| camera_of_cars(problem, options)) else { return failed() };
    if is_followed {
        problem.follow(&(answer.camera - problem.state.camera));
    }
    if is_fine {
        // The camera changed too much for the linear update of the cars to be exact. So the cars are minimised again.
        problem.knowledge.fixed = [true; 4];
        minimise(problem, &options.lm);
        if problem.information().is_none() {
            return failed();
        }
    }
    let FineCamera { information, covariance, .. } = answer;
    let pull = setup.knowledge.gradient(&problem.state.camera);
    let information = information.with_minimum_at(&problem.state.camera, &pull, options.shared_sd());
    let (cars_say, _) = information.marginal(options.shared_sd());
    let joints = problem.view_covariances(&covariance);
    let params = CameraParams::from_vector(&problem.state.camera);
    let mut cars: Vec<Option<CarSolution>> = vec![None; views.len()];
    let mut plane_evidence = vec![None; views.len()];
    for (k, (s, evidence)) in
        members.iter().zip(problem.plane_evidence(options.keypoints_as_one())).enumerate()
    {
        let view = setup.usable_views[*s].index;
        cars[view] = car_solution(problem, k, &joints[k]).map(|(car, _)| car);
        plane_evidence[view] = evidence;
    }
    let camera = Camera { lens: options.lens, ..Camera::centred(params.focal_px(), setup.size) };
    for (s, usable_view) in setup.usable_views.iter().enumerate() {
        if members.binary_search(&s).is_err() {
            let keypoints = views[usable_view.index].keypoints;
            let any = ShapePrior::default();
            let fit = fit_car(setup.atlas, &camera, &params.plane(), keypoints, &any, None, options);
            cars[usable_view.index] = fit.map(|fit| CarSolution { used: false, ..fit.car });
        }
    }
    let is_determined = setup.knowledge.is_focal_determined(&cars_say);
    let status = SceneStatus::of(report.termination, setup.knowledge.fixed[0], is_determined);
    SceneSolution {
        status,
        params,
        information,
        covariance,
        cars,
        plane_evidence,
        cost: report.cost,
        iterations: report.iterations,
        termination: report.termination,
    }
}

/// Returns a solution without cars, whose camera and covariance are those of the prior.
pub(crate) fn unsolved(setup: &Setup<'_>, views: usize, status: SceneStatus) -> SceneSolution {
    let knowledge = &setup.knowledge;
    let variance = |i, _| if knowledge.fixed[i] { 0.0 } else { 1.0 / knowledge.information[i] };
    SceneSolution {
        status,
        params: CameraParams::from_vector(&knowledge.mean),
        information: JointInformation::none(),
        covariance: Matrix4::from_diagonal(&Vector4::from_fn(variance)),
        cars: vec![None; views],
        plane_evidence: vec![None; views],
        cost: f64::INFINITY,
        iterations: 0,
        termination: Termination::Failed,
    }
}
