//! The last steps: from the camera of the first modes to that of all modes of the atlas.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{ALL_MODES, JointInformation, ShapeAtlas};

use crate::linear::lm::{LmOptions, minimise};
use crate::model::ground::PointModes;
use crate::model::latent::body_types::{BodyTypes, Gaussian, ROUNDS_OF_TYPES};
use crate::options::SceneOptions;
use crate::problem::ground::GroundProblem;
use crate::scene::marginal;

/// Rounds of weighing cars and descending with the new weights.
const ROUNDS_OF_TRUST: usize = 3;

/// What all modes say of the camera.
pub(crate) struct FineCamera {
    /// Log focal, tilt, roll, log height.
    pub camera: Vector4<f64>,
    /// What the cars say, prior not counted.
    pub information: JointInformation,
    /// Covariance, prior counted; zero rows where fixed.
    pub covariance: Matrix4<f64>,
}

/// Goes on from the minimum of `problem`. `None` where nothing is unexplained, shapes have no prior, or a car
/// cannot be evaluated.
pub(crate) fn camera_of_all_modes(
    atlas: &ShapeAtlas,
    problem: &GroundProblem<'_>,
    options: &SceneOptions,
) -> Option<FineCamera> {
    let scale = options.atlas_residual_scale;
    let known = |number: f64| number.is_finite() && number > 0.0;
    if !options.steps.all_modes || !known(scale) || !known(options.shape_prior_weight) {
        return None;
    }
    let model = PointModes::of_all_modes(atlas);
    let fine_information = options.shape_prior_weight / (scale * scale);
    let mut all = problem.with_modes(&model, |coarse| Gaussian::of_all_modes(coarse, fine_information));
    // It is near: steps need little damping.
    let lm = LmOptions { initial_damping: 1e-6, ..options.lm };
    let descend = |all: &mut GroundProblem<'_, ALL_MODES>| minimise(all, &lm).cost.is_finite().then_some(());
    // First with the wider sd of before, so that no keypoint that the fine modes explain is taken for wrong.
    descend(&mut all)?;
    all.whiten(scale, 0.0);
    descend(&mut all)?;
    let types = BodyTypes::new(atlas, options);
    for _ in 0..ROUNDS_OF_TYPES {
        all.tell_types(&types)?;
        descend(&mut all)?;
    }
    for _ in 0..if options.steps.trust { ROUNDS_OF_TRUST } else { 0 } {
        all.weigh();
        descend(&mut all)?;
    }
    told(&mut all, options)
}

/// What the cars of a problem at its minimum say of the camera: with the errors that they share in its covariance; shapes and poses
/// integrated out.
/// `None` when a car cannot be evaluated.
pub(crate) fn told<const M: usize>(
    problem: &mut GroundProblem<'_, M>,
    options: &SceneOptions,
) -> Option<FineCamera> {
    let (mut camera, alone) = (problem.state.camera, problem.covariances()?.camera_information);
    let information = match &options.view_errors {
        Some(errors) => problem.joint_information(errors)?,
        None => JointInformation::of_camera(&alone, &camera),
    };
    if options.steps.marginal {
        // As far as the minimum moves, which errors of view do not.
        let covariance = problem.knowledge.covariance(&alone, &camera)?;
        camera += marginal::change(problem, &covariance).unwrap_or_default();
    }
    let (cars, _) = information.marginal(options.shared_sd());
    let covariance = problem.knowledge.covariance(&cars, &camera)?;
    Some(FineCamera { camera, information, covariance })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ground::{CameraFrame, SHARED, Standing};
    use crate::options::Steps;
    use crate::problem::setup::{Placed, Setup};
    use crate::solution::CarView;
    use roadplane_base::{CameraPrior, FINE_MODES};
    use roadplane_synth::{CarModel, Rng, SceneTruth, SynthOptions, draw_shape, scene};

    fn options() -> SceneOptions {
        let lm = LmOptions { cost_tolerance: 1e-13, ..LmOptions::default() };
        SceneOptions {
            camera_prior: CameraPrior::none(),
            steps: Steps { trust: false, marginal: false, ..Steps::default() },
            lm,
            ..SceneOptions::default()
        }
    }

    /// Cars of so many models of all modes, their coefficients of this sd, with noise of 0.3 % of their boxes.
    fn truth(atlas: &ShapeAtlas, seed: u64, shape_sd: f64, models: usize) -> SceneTruth {
        truth_of(atlas, seed, models, |_| shape_sd)
    }

    /// The same with an sd for each model.
    fn truth_of(atlas: &ShapeAtlas, seed: u64, models: usize, shape_sd: impl Fn(usize) -> f64) -> SceneTruth {
        let mut rng = Rng::new(seed);
        let mut model = |number| {
            let shape = draw_shape(atlas, &mut rng) * shape_sd(number);
            let keypoints_in_car = std::array::from_fn(|i| atlas.keypoint_of_all_modes(i, &shape));
            CarModel { model: String::new(), weight: 1.0, keypoints_in_car }
        };
        let models = (0..models).map(&mut model).collect();
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

    #[test]
    fn without_fine_modes_nothing_changes() {
        let shipped = ShapeAtlas::shipped().unwrap();
        let mut atlas = shipped.clone();
        atlas.body_types.clear();
        atlas.fine_modes = [atlas.mean.map(|_| nalgebra::Vector3::zeros()); FINE_MODES];
        atlas.fine_residual_sd_m = atlas.residual_sd_m.map(|sd| sd / SHARED);
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
                let options =
                    SceneOptions { steps: Steps { marginal: true, ..options.steps }, ..options.clone() };
                let shifted = camera_of_all_modes(atlas, problem, &options).unwrap();
                let off = (shifted.camera - found.camera - shift).component_div(&sd).amax();
                assert!(off < 1e-2, "{seed}: {off}");
            });
        }
    }

    #[test]
    fn integrating_out_goes_where_shapes_and_poses_are_freer() {
        let atlas = ShapeAtlas::shipped().unwrap();
        for seed in 0..6 {
            let truth = truth(&atlas, seed, 1.0, 40);
            at(&atlas, &truth, &options(), 1, |_, problem, options| {
                minimise(problem, &options.lm);
                let covariance = problem.covariances().unwrap().camera;
                let here = problem.half_log_determinant().unwrap();
                let change = marginal::change(problem, &covariance).unwrap();
                let there = problem.half_log_determinant_at(&(change * 0.1)).unwrap();
                assert!(change.amax() > 1e-5 && there < here, "{seed}: {change} {there} {here}");
            });
        }
    }

    #[test]
    fn cars_of_all_modes_tell_the_camera_better() {
        let atlas = ShapeAtlas { body_types: Vec::new(), ..ShapeAtlas::shipped().unwrap() };
        let (mut six, mut all) = (0.0, 0.0);
        for seed in 0..40 {
            let truth = truth(&atlas, seed, 1.0, 40);
            at(&atlas, &truth, &options(), 1, |atlas, problem, options| {
                let focal = problem.state.camera[0];
                minimise(problem, &options.lm);
                six += (problem.state.camera[0] - focal).abs();
                all += (camera_of_all_modes(atlas, problem, options).unwrap().camera[0] - focal).abs();
            });
        }
        assert!(all < 0.7 * six, "{all} against {six}");
    }

    #[test]
    fn body_types_tell_how_large_the_scene_is() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let without_types = ShapeAtlas { body_types: Vec::new(), ..atlas.clone() };
        let (mut known, mut unknown, mut squared_sds) = (0.0, 0.0, 0.0);
        for seed in 0..40 {
            let truth = truth(&atlas, seed, 1.0, 40);
            let of_atlas = |atlas: &ShapeAtlas| {
                let (mut error, mut sd) = (0.0, 0.0);
                at(atlas, &truth, &options(), 1, |atlas, problem, options| {
                    let found = camera_of_all_modes(atlas, problem, options).unwrap();
                    error = found.camera[3] - problem.state.camera[3];
                    sd = found.covariance[(3, 3)].sqrt();
                });
                (error, sd)
            };
            let (error, sd) = of_atlas(&atlas);
            known += error.abs();
            squared_sds += (error / sd).powi(2) / 40.0;
            unknown += of_atlas(&without_types).0.abs();
        }
        assert!(squared_sds < 1.5, "{squared_sds}");
        assert!(known < 0.85 * unknown, "{known} against {unknown}");
    }

    #[test]
    fn a_few_cars_unlike_the_atlas_do_not_turn_the_camera() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let (mut trusted, mut weighed) = (0.0, 0.0);
        for seed in 0..60 {
            let truth = truth_of(&atlas, seed, 40, |model| if model % 6 == 0 { 4.0 } else { 0.7 });
            at(&atlas, &truth, &options(), 1, |atlas, problem, options| {
                let true_camera = problem.state.camera;
                minimise(problem, &options.lm);
                let error = |trust: bool| {
                    let options = SceneOptions { steps: Steps { trust, ..options.steps }, ..options.clone() };
                    let found = camera_of_all_modes(atlas, problem, &options).unwrap();
                    (found.camera[0] - true_camera[0]).abs()
                };
                trusted += error(false);
                weighed += error(true);
            });
        }
        assert!(weighed < 0.9 * trusted, "{weighed} against {trusted}");
    }
}
