//! Scenes that the speed figures are measured on: N cars with 2 % noise, and a start near the truth.

use nalgebra::{Point3, Vector2};
use roadplane_base::{Camera, CameraParams, GroundPose, Shape, ShapeAtlas};
use roadplane_solve::{CarView, KnownScene};
use roadplane_synth::{CarTruth, Rng, SceneTruth, SynthOptions, scene};

/// CPU seconds of this thread; the kernel counts in steps of milliseconds.
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|n| n.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}

/// CPU seconds that one run takes, from as many as fill 60 ms, and the last one's result.
pub fn timed<T>(mut work: impl FnMut() -> T) -> (f64, T) {
    let mut runs = 1.0;
    let start = cpu_seconds();
    let mut result = work();
    while cpu_seconds() - start < 0.06 {
        result = work();
        runs += 1.0;
    }
    ((cpu_seconds() - start) / runs, result)
}

/// A scene with a start near its truth.
pub struct BenchScene {
    /// The scene.
    pub truth: SceneTruth,
    params: CameraParams,
    poses: Vec<GroundPose>,
    shapes: Vec<Shape>,
}

impl BenchScene {
    /// The scene of a number of cars and a seed; many cars need room, so they come with a higher camera. The start is the
    /// truth disturbed as the stages before the last refinement leave it: 1 % in focal length and height, 0.1° in tilt; cars
    /// are where they are seen to 1 % of their box, heading off by 0.6°, shape by a third of a sd. `None` if a car comes to lie above the horizon.
    pub fn new(atlas: &ShapeAtlas, cars: usize, seed: u64) -> Option<Self> {
        let asked = SynthOptions {
            cars,
            noise: 0.02,
            box_px: if cars > 30 { [12.0, 300.0] } else { [50.0, 700.0] },
            height_m: if cars > 30 { [25.0, 45.0] } else { [4.0, 30.0] },
            tilt: if cars > 30 { [0.35, 0.7] } else { [0.087, 0.87] },
            focal_ratio: [0.6, if cars > 30 { 0.9 } else { 4.0 }],
            ..SynthOptions::default()
        };
        let truth = scene(atlas, &asked, 40 + seed);
        let mut rng = Rng::new(9);
        let mut params = truth.params;
        params.log_focal += 0.01;
        params.tilt += 0.002;
        params.log_height -= 0.01;
        let (camera, plane) = (Camera::centred(truth.params.focal_px(), truth.size), truth.params.plane());
        let camera_from_world = plane.camera_from_world();
        let started = Camera::centred(params.focal_px(), truth.size);
        let place = |car: &CarTruth| {
            let origin = camera_from_world * Point3::new(car.pose.x_m, car.pose.y_m, 0.0);
            let seen = camera.pixel_from_camera(&origin.coords)?;
            let moved = seen + Vector2::new(rng.normal(), rng.normal()) * (0.01 * car.box_px);
            let on_ground = params.plane().world_from_pixel(&started, &moved)?;
            let heading_rad = car.pose.heading_rad + 0.01 * rng.normal();
            Some(GroundPose { x_m: on_ground.x, y_m: on_ground.y, heading_rad })
        };
        let poses = truth.cars.iter().map(place).collect::<Option<Vec<_>>>()?;
        let shapes = truth.cars.iter().map(|car| car.shape.map(|c| c + 0.3 * rng.normal())).collect();
        Some(Self { truth, params, poses, shapes })
    }

    /// The solver's input.
    pub fn views(&self) -> Vec<CarView<'_>> {
        let view = |(group, car)| {
            let car: &CarTruth = car;
            CarView { keypoints: &car.keypoints, group, weight: 1.0 }
        };
        self.truth.cars.iter().enumerate().map(view).collect()
    }

    /// Where to start.
    pub fn start(&self) -> KnownScene<'_> {
        KnownScene { params: self.params, poses: &self.poses, shapes: &self.shapes }
    }
}
