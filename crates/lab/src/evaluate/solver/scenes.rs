//! What all tables need of a synthetic scene.

use roadplane_base::{GroundPose, Shape, ShapeAtlas};
use roadplane_solve::{
    CameraPrior, CarView, GivenScene, OutlierModel, SceneOptions, SceneSolution, scene_bound,
};
use roadplane_synth::{CarModel, SceneTruth};

/// True poses and shapes.
pub(super) fn known(truth: &SceneTruth) -> (Vec<GroundPose>, Vec<Shape>) {
    truth.cars.iter().map(|car| (car.pose, car.shape)).unzip()
}

/// Nothing is known of the camera; cars are those of the atlas but for `atlas_residual_scale` times what it leaves
/// unexplained.
pub(super) fn without_camera_prior(atlas_residual_scale: f64) -> SceneOptions {
    SceneOptions { camera_prior: CameraPrior::none(), atlas_residual_scale, ..SceneOptions::default() }
}

/// The Cramér–Rao bound of the right keypoints of the right cars.
pub(super) fn bound(atlas: &ShapeAtlas, truth: &SceneTruth, options: &SceneOptions) -> Option<SceneSolution> {
    let mut right = truth.clone();
    for car in &mut right.cars {
        for i in 0..car.keypoints.len() {
            if car.wrong || car.outlier[i] {
                car.keypoints[i] = None;
            }
        }
    }
    let (poses, shapes) = known(&right);
    let options = SceneOptions { kernel: OutlierModel::none(), ..options.clone() };
    let at = GivenScene { params: truth.params, poses: &poses, shapes: &shapes };
    scene_bound(atlas, truth.size, &CarView::each(right.keypoints()), &at, &options)
}

/// Models that the atlas was not built on (`python -m cars.atlas --foreign`).
pub(super) fn foreign_cars() -> Vec<CarModel> {
    // Compiled in and checked by a test, so it cannot fail at run time.
    CarModel::list_from_json(include_str!("../../../../../tests/data/foreign_cars.json")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_other_models_are_there() {
        assert!(foreign_cars().len() > 10);
    }
}
