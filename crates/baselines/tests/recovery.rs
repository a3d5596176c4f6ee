//! Tests both baselines on keypoints of cars with known poses.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use nalgebra::{Isometry3, Matrix3, Vector2};
use roadplane_base::{Camera, KEYPOINTS, Keypoint, KeypointSet, ShapeAtlas};
use roadplane_baselines::{CarFit, krishna_murthy, pavlakos, weak_perspective};
use roadplane_synth::{SceneTruth, SynthOptions, scene};

type Method = fn(&ShapeAtlas, &Camera, &KeypointSet) -> Option<CarFit>;

fn camera_of(truth: &SceneTruth) -> Camera {
    Camera::centred(truth.params.focal_px(), truth.size)
}

/// Returns three errors of every car in the scenes of the seeds: rotation error (rad), relative translation error, and
/// norm of the shape error.
fn errors(method: Method, options: &SynthOptions, seeds: std::ops::Range<u64>) -> Vec<[f64; 3]> {
    let atlas = ShapeAtlas::shipped().unwrap();
    let mut errors = Vec::new();
    for seed in seeds {
        let truth = scene(&atlas, options, seed);
        for car in &truth.cars {
            let pose: Isometry3<f64> = truth.params.plane().camera_from_world() * car.pose.world_from_car();
            let fit = method(&atlas, &camera_of(&truth), &car.keypoints).unwrap();
            let off = fit.camera_from_car.translation.vector - pose.translation.vector;
            errors.push([
                fit.camera_from_car.rotation.angle_to(&pose.rotation),
                off.norm() / pose.translation.vector.norm(),
                (fit.shape - car.shape).norm(),
            ]);
        }
    }
    errors
}

fn within(errors: &[[f64; 3]], limits: [f64; 3]) -> f64 {
    let good = errors.iter().filter(|error| error.iter().zip(limits).all(|(e, limit)| *e <= limit)).count();
    good as f64 / errors.len() as f64
}

fn noise_free() -> SynthOptions {
    SynthOptions { cars: 5, noise: 0.0, shape_sd: 0.0, seen: 1.0, ..SynthOptions::default() }
}

#[test]
fn mean_cars_come_out_exactly() {
    for (name, method, limit) in [
        ("pavlakos", pavlakos as Method, [1e-3, 1e-3, 1e-2]),
        ("krishna_murthy", krishna_murthy, [1e-5, 1e-5, 1e-4]),
    ] {
        let errors = errors(method, &noise_free(), 0..40);
        let share = within(&errors, limit);
        println!("{name}: {:.1} % of {}", 100.0 * share, errors.len());
        assert!(share >= 0.99, "{name}: {share}");
    }
}

#[test]
fn cars_of_other_shapes_come_out_nearly() {
    // The prior changes the shapes a little, but it must not spoil the pose.
    let options = SynthOptions { shape_sd: 1.0, ..noise_free() };
    for (name, method) in [("pavlakos", pavlakos as Method), ("krishna_murthy", krishna_murthy)] {
        let errors = errors(method, &options, 0..40);
        let share = within(&errors, [0.1, 0.1, 3.0]);
        println!("{name}: {:.1} % of {}", 100.0 * share, errors.len());
        assert!(share >= 0.9, "{name}: {share}");
    }
}

#[test]
fn noise_costs_accuracy_only() {
    let options = SynthOptions { shape_sd: 1.0, noise: 0.01, seen: 0.6, ..noise_free() };
    for (name, method) in [("pavlakos", pavlakos as Method), ("krishna_murthy", krishna_murthy)] {
        let errors = errors(method, &options, 0..40);
        let share = within(&errors, [0.28, 0.3, f64::INFINITY]);
        println!("{name}: {:.1} % of {}", 100.0 * share, errors.len());
        assert!(share >= 0.6, "{name}: {share}");
    }
}

#[test]
fn weak_perspective_is_exact_on_its_own_images() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let truth = scene(&atlas, &noise_free(), 1);
    let camera = camera_of(&truth);
    let (mut good, mut count) = (0, 0);
    for seed in 0..30 {
        for car in &scene(&atlas, &noise_free(), seed).cars {
            let tilt = 0.1 + 0.02 * seed as f64;
            let turn = nalgebra::Rotation3::from_euler_angles(-std::f64::consts::FRAC_PI_2 - tilt, 0.0, 0.0)
                * nalgebra::Rotation3::from_euler_angles(0.0, 0.0, car.pose.heading_rad);
            let rotation: Matrix3<f64> = turn.into_inner();
            let (scale, centre) = (0.03, Vector2::new(0.1, -0.05));
            let keypoints: KeypointSet = std::array::from_fn(|i| {
                let xy = (rotation * atlas.mean[i]).xy() * scale + centre;
                Some(Keypoint::isotropic(camera.principal_point_px + xy * camera.focal_px, 1.0, 1.0))
            });
            let found = weak_perspective(&atlas, &camera, &keypoints).unwrap();
            count += 1;
            let close =
                (found.camera_from_car - rotation).norm() < 1e-3 && (found.scale - scale).abs() < 1e-5;
            good += usize::from(close);
        }
    }
    assert_eq!(good, count, "of {count}");
}

#[test]
fn keypoints_that_cannot_be_fitted_give_none() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let camera = Camera::pinhole(1000.0, Vector2::new(640.0, 360.0));
    let point = |x: f64| Some(Keypoint::isotropic(Vector2::new(x, 300.0), 1.0, 1.0));
    let mut few: KeypointSet = [None; KEYPOINTS];
    for (i, slot) in few.iter_mut().take(4).enumerate() {
        *slot = point(100.0 * i as f64);
    }
    let one_point: KeypointSet = [point(100.0); KEYPOINTS];
    let broken: KeypointSet = [point(f64::NAN); KEYPOINTS];
    let unsure: KeypointSet =
        std::array::from_fn(|i| Some(Keypoint::isotropic(Vector2::new(i as f64, 1.0), 0.0, 1.0)));
    let no_camera = Camera { focal_px: f64::NAN, ..camera };
    let whole = scene(&atlas, &noise_free(), 0).cars[0].keypoints;
    for method in [pavlakos as Method, krishna_murthy] {
        for keypoints in [&[None; KEYPOINTS], &few, &one_point, &broken, &unsure] {
            assert!(method(&atlas, &camera, keypoints).is_none());
        }
        assert!(method(&atlas, &no_camera, &whole).is_none());
    }
}
