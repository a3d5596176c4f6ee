//! The last steps: from the camera of six modes to that of all modes of the atlas.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::ShapeAtlas;

use crate::fine_problem::{Eliminated, FineProblem, FineState, Linearisation};
use crate::ground_problem::GroundProblem;
use crate::marginal::{self, Valley};
use crate::options::SceneOptions;

/// Steps at most.
const MAX_STEPS: usize = 30;
/// Ever smaller steps that are tried.
const MAX_TRIES: i32 = 6;
/// The cost falls by less than this share: the minimum.
const COST_TOLERANCE: f64 = 1e-9;

/// What all modes say of the camera.
pub(crate) struct FineCamera {
    /// Log focal, tilt, roll, log height.
    pub camera: Vector4<f64>,
    /// Information of the cars, prior not counted.
    pub information: Matrix4<f64>,
    /// Covariance, prior counted; zero rows where fixed.
    pub covariance: Matrix4<f64>,
}

/// Goes on from the minimum of `problem`. `None` where nothing is unexplained, shapes have no prior, a car cannot be evaluated or
/// no minimum is found.
pub(crate) fn camera_of_all_modes(
    atlas: &ShapeAtlas,
    problem: &GroundProblem<'_>,
    options: &SceneOptions,
) -> Option<FineCamera> {
    let known = |number: f64| number.is_finite() && number > 0.0;
    if !known(options.atlas_residual_scale) || !known(options.shape_prior_weight) {
        return None;
    }
    let mut descent = Descent::new(FineProblem::new(atlas, problem, options))?;
    // First with the wider sd of before, so that no keypoint that the fine modes explain is taken for wrong.
    descent.descend()?;
    descent.problem.whiten();
    descent.linearise()?;
    descent.descend()?;
    let covariance = descent.problem.covariance(&descent.eliminated)?;
    let shift = if options.marginal { marginal::change(&mut descent, &covariance) } else { None };
    Some(FineCamera {
        camera: descent.problem.state.camera + shift.unwrap_or_default(),
        information: descent.eliminated.information,
        covariance,
    })
}

/// The problem with what belongs to its state, and room for a trial.
struct Descent<'a> {
    problem: FineProblem<'a>,
    at: Linearisation,
    eliminated: Eliminated,
    trial: FineState,
    trial_at: Linearisation,
    trial_eliminated: Eliminated,
}

impl<'a> Descent<'a> {
    fn new(problem: FineProblem<'a>) -> Option<Self> {
        let mut descent = Self {
            trial: problem.state.clone(),
            trial_at: Linearisation::default(),
            trial_eliminated: Eliminated::default(),
            problem,
            at: Linearisation::default(),
            eliminated: Eliminated::default(),
        };
        descent.linearise()?;
        Some(descent)
    }

    fn linearise(&mut self) -> Option<()> {
        self.problem.linearise(&self.problem.state, &mut self.at)?;
        self.problem.eliminate(&self.at, &self.problem.state, &mut self.eliminated)
    }

    /// To the minimum. `None` when a car cannot be evaluated or the steps are used up.
    fn descend(&mut self) -> Option<()> {
        for _ in 0..MAX_STEPS {
            let before = self.at.cost;
            if !self.step()? || before - self.at.cost <= COST_TOLERANCE * before {
                return Some(());
            }
        }
        None
    }

    /// The largest of ever smaller steps that lowers the cost; false when none does.
    fn step(&mut self) -> Option<bool> {
        let whole = self.problem.camera_step(&self.eliminated)?;
        for halvings in 0..MAX_TRIES {
            let share = 0.5_f64.powi(halvings);
            self.problem.moved(&self.eliminated, &(whole * share), share, &mut self.trial);
            if self.problem.linearise(&self.trial, &mut self.trial_at).is_some()
                && self.trial_at.cost < self.at.cost
            {
                std::mem::swap(&mut self.problem.state, &mut self.trial);
                std::mem::swap(&mut self.at, &mut self.trial_at);
                self.problem.eliminate(&self.at, &self.problem.state, &mut self.eliminated)?;
                return Some(true);
            }
        }
        Some(false)
    }
}

impl Valley for Descent<'_> {
    fn half_log_determinant(&self) -> Option<f64> {
        Some(self.eliminated.half_log_determinant)
    }

    fn half_log_determinant_at(&mut self, change: &Vector4<f64>) -> Option<f64> {
        self.problem.moved(&self.eliminated, change, 0.0, &mut self.trial);
        self.problem.linearise(&self.trial, &mut self.trial_at)?;
        self.problem.eliminate(&self.trial_at, &self.trial, &mut self.trial_eliminated)?;
        Some(self.trial_eliminated.half_log_determinant)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::ground_residual::{CameraFrame, PointModes, Standing};
    use crate::lm::{LmOptions, minimise};
    use crate::options::CameraPrior;
    use crate::setup::{Placed, Setup};
    use crate::solution::CarView;
    use roadplane_base::{FINE_MODES, Shape};
    use roadplane_synth::{CarModel, Rng, SceneTruth, SynthOptions, scene};

    fn options() -> SceneOptions {
        let lm = LmOptions { cost_tolerance: 1e-13, ..LmOptions::default() };
        SceneOptions { camera_prior: CameraPrior::none(), marginal: false, lm, ..SceneOptions::default() }
    }

    /// Cars of so many models of all modes, their coefficients of this sd, with noise of 0.3 % of their boxes.
    fn truth(atlas: &ShapeAtlas, seed: u64, shape_sd: f64, models: usize) -> SceneTruth {
        let mut rng = Rng::new(seed);
        let mut model = || {
            let shape = Shape::from_fn(|_, _| shape_sd * rng.normal());
            let mut keypoints_in_car = atlas.keypoints_in_car(&shape);
            for mode in &atlas.fine_modes {
                let coefficient = shape_sd * rng.normal();
                for (point, by) in keypoints_in_car.iter_mut().zip(mode) {
                    *point += by * coefficient;
                }
            }
            CarModel { model: String::new(), weight: 1.0, keypoints_in_car }
        };
        let models = (0..models).map(|_| model()).collect();
        scene(atlas, &SynthOptions { models, noise: 0.003, ..SynthOptions::default() }, seed)
    }

    /// `views_per_car`: how many cars in a row are taken for views of one.
    fn at(
        atlas: &ShapeAtlas,
        truth: &SceneTruth,
        options: &SceneOptions,
        views_per_car: usize,
        see: impl FnOnce(&ShapeAtlas, &mut GroundProblem<'_>, &SceneOptions),
    ) {
        let views: Vec<CarView<'_>> = truth
            .cars
            .iter()
            .enumerate()
            .map(|(i, car)| CarView { keypoints: &car.keypoints, group: i / views_per_car, weight: 1.0 })
            .collect();
        let model = PointModes::new(atlas);
        let setup = Setup::new(atlas, &model, truth.size, &views, options);
        let camera = truth.params.to_vector();
        let frame = CameraFrame::new(&camera);
        let place = |index: usize| {
            let car = &truth.cars[index];
            let anchor = frame.anchor_of(&car.pose)?;
            Some(Placed { standing: Standing { anchor, heading: car.pose.heading_rad }, shape: car.shape })
        };
        let placed: Vec<_> = setup.sights.iter().map(|sight| place(sight.index)).collect();
        let (mut problem, _) = setup.problem(camera, &placed);
        problem.whiten(options.atlas_residual_scale, 0.0);
        see(atlas, &mut problem, options);
    }

    /// Calls with the problem of a scene at the truth.
    pub(crate) fn at_truth(seed: u64, see: impl FnOnce(&ShapeAtlas, &mut GroundProblem<'_>, &SceneOptions)) {
        let atlas = ShapeAtlas::shipped().unwrap();
        at(&atlas, &truth(&atlas, seed, 1.0, 40), &options(), 1, see);
    }

    #[test]
    fn without_fine_modes_nothing_changes() {
        let shipped = ShapeAtlas::shipped().unwrap();
        let mut atlas = shipped.clone();
        atlas.fine_modes = [atlas.mean.map(|_| nalgebra::Vector3::zeros()); FINE_MODES];
        atlas.fine_residual_sd_m = atlas.residual_sd_m;
        for seed in 0..6 {
            // Small coefficients stay within bounds, which only the problem of six modes has.
            // Every other scene has cars all alike, two of which are taken for views of one.
            let (models, views_per_car) = if seed % 2 == 0 { (40, 1) } else { (1, 2) };
            let truth = truth(&shipped, seed, 0.3, models);
            let known_focal_px = (seed % 3 == 0).then(|| truth.params.focal_px());
            let options = SceneOptions { known_focal_px, ..options() };
            at(&atlas, &truth, &options, views_per_car, |atlas, problem, options| {
                minimise(problem, &options.lm);
                problem.whiten(options.atlas_residual_scale, 0.0);
                minimise(problem, &options.lm);
                let known = problem.covariances().unwrap();
                let found = camera_of_all_modes(atlas, problem, options).unwrap();
                let sd = known.camera.diagonal().map(|variance| variance.sqrt().max(1e-9));
                let off = (found.camera - problem.state.camera).component_div(&sd).amax();
                assert!(off < 1e-3, "{seed}: {off}");
                let scale = sd * sd.transpose();
                assert!((found.covariance - known.camera).component_div(&scale).amax() < 1e-3);
                // The integral over shapes and poses is the same one, too.
                let shift = marginal::change(problem, &known.camera).unwrap();
                let options = SceneOptions { marginal: true, ..*options };
                let shifted = camera_of_all_modes(atlas, problem, &options).unwrap();
                let off = (shifted.camera - found.camera - shift).component_div(&sd).amax();
                assert!(off < 1e-2, "{seed}: {off}");
            });
        }
    }

    #[test]
    fn cars_of_all_modes_tell_the_camera_better() {
        let (mut six, mut all) = (0.0, 0.0);
        for seed in 0..40 {
            at_truth(seed, |atlas, problem, options| {
                let focal = problem.state.camera[0];
                minimise(problem, &options.lm);
                six += (problem.state.camera[0] - focal).abs();
                all += (camera_of_all_modes(atlas, problem, options).unwrap().camera[0] - focal).abs();
            });
        }
        assert!(all < 0.7 * six, "{all} against {six}");
    }
}
