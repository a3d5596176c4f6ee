//! Rows 4 and 5 of the tables: our solver with all cars on one ground plane. The focal length is given in row 4 and
//! estimated in row 5.
//!
//! In a further row the true ground plane is given. This row separates errors of the ground from errors of the cars.

use roadplane_base::{Camera, KeypointSet, ShapeAtlas};
use roadplane_pipeline::Config;
use roadplane_solve::{CarSolution, CarView, SceneStatus, ShapePrior, fit_car, solve_scene};

use super::answer::{CameraAnswer, CarAnswer, FrameAnswer, FrameInput};

pub(super) fn solve(
    atlas: &ShapeAtlas,
    input: &FrameInput<'_>,
    focal_px: Option<f64>,
    config: &Config,
) -> FrameAnswer {
    let options = config.solve.scene_options(focal_px);
    let solution = solve_scene(atlas, input.size, &CarView::each(input.cars), &options);
    let answer = |car: &Option<CarSolution>| {
        car.as_ref().map(|car| CarAnswer { camera_from_car: car.camera_from_car, shape: car.shape })
    };
    let found = !matches!(solution.status, SceneStatus::TooFewCars | SceneStatus::Failed);
    let camera = CameraAnswer {
        focal_px: solution.params.focal_px(),
        plane: solution.params.plane(),
        covariance: solution.covariance,
    };
    FrameAnswer { cars: solution.cars.iter().map(answer).collect(), camera: found.then_some(camera) }
}

/// Estimates the pose of each car on its own, on the true ground plane of the input.
pub(super) fn solve_on(atlas: &ShapeAtlas, input: &FrameInput<'_>, config: &Config) -> FrameAnswer {
    let camera = Camera::centred(input.focal_px, input.size);
    let options = config.solve.scene_options(Some(input.focal_px));
    let car = |keypoints: &KeypointSet| {
        let shape = ShapePrior::default();
        let fit = fit_car(atlas, &camera, &input.plane, keypoints, &shape, None, &options)?;
        Some(CarAnswer { camera_from_car: fit.car.camera_from_car, shape: fit.car.shape })
    };
    FrameAnswer { cars: input.cars.iter().map(car).collect(), camera: None }
}
