//! Rows 1 and 2 of the tables: two published baselines, which solve one car at a time.

use roadplane_base::{Camera, KeypointSet, ShapeAtlas};
use roadplane_baselines::CarFit;

use super::answer::{CarAnswer, FrameAnswer, FrameInput};

/// Estimates the pose of each car of a frame on its own, with the given baseline `method`.
pub(super) fn solve(
    method: fn(&ShapeAtlas, &Camera, &KeypointSet) -> Option<CarFit>,
    atlas: &ShapeAtlas,
    input: &FrameInput<'_>,
) -> FrameAnswer {
    let camera = Camera::centred(input.focal_px, input.size);
    let car = |keypoints: &KeypointSet| {
        let CarFit { camera_from_car, shape } = method(atlas, &camera, keypoints)?;
        Some(CarAnswer { camera_from_car, shape })
    };
    FrameAnswer { cars: input.cars.iter().map(car).collect(), camera: None }
}
