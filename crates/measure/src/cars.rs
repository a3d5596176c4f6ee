//! Fits the cars of a frame on the ground, with a known camera.

use nalgebra::SMatrix;
use roadplane_base::{FrameRecord, GroundPose, MODES, Shape, ShapeAtlas, VehicleClass};
use roadplane_solve::{CarFit, SceneOptions, ShapePrior, fit_car};

use crate::{FrameCamera, usable};

/// Ratio of the sd of a measured pose to the sd that follows from independent errors of the keypoints. Keypoints of one
/// crop share a part of their errors.
///
/// On 18 rendered clips with the true camera, the ratio is 1.4 (9749 poses of 369 cars). The errors of keypoints relative
/// to their sds are 1.5 times as large on real cars as on rendered cars (`models/hourglass.md`).
pub const POSE_SD_RATIO: f64 = 2.0;

/// Returns the prior of the shape of any car of a site.
///
/// `size_of_cars` is the log of the size of the site's cars relative to the atlas.
#[must_use]
pub fn any_car(atlas: &ShapeAtlas, size_of_cars: f64) -> ShapePrior {
    // Coefficients nearest to the scaled mean car, by least squares over its keypoints.
    let mut normal = SMatrix::<f64, MODES, MODES>::zeros();
    let mut right = Shape::zeros();
    for (i, mean) in atlas.mean.iter().enumerate() {
        let modes = SMatrix::<f64, 3, MODES>::from_fn(|axis, mode| atlas.modes[mode][i][axis]);
        normal += modes.transpose() * modes;
        right += modes.transpose() * mean * size_of_cars.exp_m1();
    }
    let mean = normal.cholesky().map_or_else(Shape::zeros, |normal| normal.solve(&right));
    ShapePrior { mean: atlas.clamped(&mean), ..ShapePrior::default() }
}

/// Fits every car of the frame that has keypoints.
///
/// Keypoints with scores below `min_keypoint_score` do not count. `known(i)` returns the prior of car i: its shape, and its
/// approximate pose if there is one. Ground poses are in coordinates on the surface; the covariance of pose and shape is
/// that on the car's plane alone.
pub fn fit_frame(
    frame: &FrameRecord,
    view: &FrameCamera,
    atlas: &ShapeAtlas,
    options: &SceneOptions,
    min_keypoint_score: f64,
    known: impl Fn(usize) -> (ShapePrior, Option<GroundPose>),
) -> Vec<Option<CarFit>> {
    let fit = |(i, car): (usize, &roadplane_base::CarRecord)| {
        if car.class != VehicleClass::Car {
            return None;
        }
        let keypoints = usable(car.keypoints.as_deref()?, min_keypoint_score);
        let (shape, start) = known(i);
        let part = view.part_of_box(&car.bbox_px);
        let start = start.map(|pose| part.from_surface(&pose));
        let mut fit = fit_car(atlas, &view.camera, &part.plane, &keypoints, &shape, start.as_ref(), options)?;
        fit.car.ground = part.to_surface(&fit.car.ground);
        fit.car.ground_covariance = part.covariance_to_surface(&fit.car.ground_covariance);
        Some(fit)
    };
    frame.cars.iter().enumerate().map(fit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cars_of_a_place_are_as_large_as_it_says() {
        let atlas = ShapeAtlas::shipped().unwrap();
        assert_eq!(any_car(&atlas, 0.0), ShapePrior::default());
        for log_size in [-0.05, 0.02, 0.05] {
            let dims_m = atlas.dims_m(&any_car(&atlas, log_size).mean);
            // In the modes of cars, the width grows less than length and height.
            let larger = dims_m.component_div(&atlas.dims_mean).map(f64::ln) / log_size;
            assert!((larger.mean() - 1.0).abs() < 0.2 && larger.min() > 0.5, "{log_size}: {larger}");
        }
    }
}
