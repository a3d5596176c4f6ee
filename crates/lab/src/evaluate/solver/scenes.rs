//! Helpers for synthetic scenes that several tables use.

use roadplane_base::{GroundPose, Shape, ShapeAtlas};
use roadplane_solve::{
    CameraPrior, CarView, GivenScene, OutlierModel, SceneOptions, SceneSolution, scene_bound,
};
use roadplane_synth::{CarModel, SceneTruth};

/// Returns the true poses and shapes of a scene.
pub(super) fn true_poses_and_shapes(truth: &SceneTruth) -> (Vec<GroundPose>, Vec<Shape>) {
    truth.cars.iter().map(|car| (car.pose, car.shape)).unzip()
}

/// Returns solve options without a prior on the camera. `atlas_residual_scale` multiplies the shape atlas's residual on
/// real cars.
pub(super) fn without_camera_prior(atlas_residual_scale: f64) -> SceneOptions {
    SceneOptions { camera_prior: CameraPrior::none(), atlas_residual_scale, ..SceneOptions::default() }
}

/// Returns the Cramér–Rao bound of a scene, without the scene's outliers and false cars.
pub(super) fn bound(atlas: &ShapeAtlas, truth: &SceneTruth, options: &SceneOptions) -> Option<SceneSolution> {
    let mut right = truth.clone();
    for car in &mut right.cars {
        for i in 0..car.keypoints.len() {
            if car.wrong || car.outlier[i] {
                car.keypoints[i] = None;
            }
        }
    }
    let (poses, shapes) = true_poses_and_shapes(&right);
    let options = SceneOptions { kernel: OutlierModel::none(), ..options.clone() };
    let at = GivenScene { params: truth.params, poses: &poses, shapes: &shapes };
    scene_bound(atlas, truth.size, &CarView::each(right.keypoints()), &at, &options)
}

/// Returns car models that were not used to build the shape atlas (from `roadplane-train cars atlas --foreign`).
pub(super) fn foreign_cars() -> Vec<CarModel> {
    // The list is compiled in and checked by a test, so parsing cannot fail at run time.
    CarModel::list_from_json(include_str!("../../../../../tests/data/foreign_cars.json")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_foreign_models_are_compiled_in() {
        assert!(foreign_cars().len() > 10);
    }
}
