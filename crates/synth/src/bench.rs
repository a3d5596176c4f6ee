//! Initial values for tests of the solver: values near the truth of benchmark scenes, and random cameras.

use nalgebra::{Point3, Vector2};
use roadplane_base::{Camera, CameraParams, GroundPose, ImageSize, Shape, ShapeAtlas};

use crate::{CarTruth, Rng, SceneTruth, SynthOptions, scene};

/// Least number of cars in a large scene. A large scene has a higher camera, to have room for the cars.
const MANY: usize = 31;

/// A scene with initial values near its truth. They are as accurate as the usual input of the joint refinement.
#[derive(Clone, Debug)]
pub struct BenchScene {
    /// The scene with its truth.
    pub truth: SceneTruth,
    /// Initial camera. Its focal length and height are off by 1 %, and its tilt by 0.1°.
    pub params: CameraParams,
    /// Initial poses of the cars. The sd of the position errors is 1 % of the car's box in the image. The sd of the
    /// heading errors is 0.6°.
    pub poses: Vec<GroundPose>,
    /// Initial shapes of the cars. The sd of the errors is about a third of the sd of the shape coefficients.
    pub shapes: Vec<Shape>,
}

impl BenchScene {
    /// Creates a scene of several cars, whose keypoints have 2 % noise. A large scene has a higher camera.
    ///
    /// Returns `None` if an initial position would be above the horizon.
    #[must_use]
    pub fn new(atlas: &ShapeAtlas, cars: usize, seed: u64) -> Option<Self> {
        let many = cars >= MANY;
        let asked = SynthOptions {
            cars,
            noise: 0.02,
            box_px: if many { [12.0, 300.0] } else { [50.0, 700.0] },
            height_m: if many { [25.0, 45.0] } else { [4.0, 30.0] },
            tilt: if many { [0.35, 0.7] } else { [0.087, 0.87] },
            focal_ratio: [0.6, if many { 0.9 } else { 4.0 }],
            ..SynthOptions::default()
        };
        let truth = scene(atlas, &asked, 40 + seed);
        let mut rng = Rng::new(9);
        let mut params = truth.params;
        params.log_focal += 0.01;
        params.tilt += 0.002;
        params.log_height -= 0.01;
        let camera_from_world = truth.params.plane().camera_from_world();
        let camera = Camera::centred(truth.params.focal_px(), truth.size);
        let started = Camera::centred(params.focal_px(), truth.size);
        let start_pose = |car: &CarTruth| {
            let origin = camera_from_world * Point3::new(car.pose.x_m, car.pose.y_m, 0.0);
            let off = Vector2::new(rng.normal(), rng.normal()) * (0.01 * car.box_px);
            let seen = camera.pixel_from_camera(&origin.coords)? + off;
            let on_ground = params.plane().world_from_pixel(&started, &seen)?;
            let heading_rad = car.pose.heading_rad + 0.01 * rng.normal();
            Some(GroundPose { x_m: on_ground.x, y_m: on_ground.y, heading_rad })
        };
        let poses = truth.cars.iter().map(start_pose).collect::<Option<Vec<_>>>()?;
        let shapes = truth.cars.iter().map(|car| car.shape.map(|c| c + 0.3 * rng.normal())).collect();
        Some(Self { truth, params, poses, shapes })
    }
}

/// Returns a random initial camera, which does not depend on any scene.
///
/// The focal length is 0.3–8 times the image's width. Tilt, roll and height are random, too.
#[must_use]
pub fn random_camera(size: ImageSize, seed: u64) -> CameraParams {
    let mut rng = Rng::new(seed ^ 0x57a7);
    let width = f64::from(size.width);
    CameraParams {
        log_focal: rng.uniform((0.3 * width).ln(), (8.0 * width).ln()),
        tilt: rng.uniform(0.05, 1.2),
        roll: rng.uniform(-0.2, 0.2),
        log_height: rng.uniform(3f64.ln(), 40f64.ln()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_start_is_near_but_not_at_the_truth() {
        let atlas = ShapeAtlas::shipped().unwrap();
        for cars in [5, 50] {
            let bench = BenchScene::new(&atlas, cars, 0).unwrap();
            assert_eq!(bench.poses.len(), bench.truth.cars.len());
            for (car, start) in bench.truth.cars.iter().zip(&bench.poses) {
                let off = (car.pose.x_m - start.x_m).hypot(car.pose.y_m - start.y_m);
                let away = car.pose.x_m.hypot(car.pose.y_m);
                assert!(off > 0.0 && off < 0.1 * away, "{off} m at {away} m");
            }
        }
    }
}
