//! Measured keypoints of a scene: visibility, noise and outliers.

use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector2, Vector3};
use roadplane_base::{Camera, KEYPOINTS, Keypoint, mirror_index};

use crate::Rng;
use crate::truth::{SceneTruth, SynthOptions, Wrong};

/// Sd that keypoints without noise report, as a share of the car's box.
pub(crate) const CLAIMED_NOISE: f64 = 0.01;

/// Computes the measured keypoints of every car, and stores them in the scene.
pub(crate) fn measure(truth: &mut SceneTruth, options: &SynthOptions, rng: &mut Rng) {
    let camera = Camera::centred(truth.params.focal_px(), truth.size);
    let camera_from_world = truth.params.plane().camera_from_world();
    let wrong_cars = (options.wrong_cars * truth.cars.len() as f64).round() as usize;
    for (k, car) in truth.cars.iter_mut().enumerate() {
        let camera_from_car = camera_from_world * car.pose.world_from_car();
        car.wrong = k < wrong_cars;
        let kinds = [Wrong::OtherPose, Wrong::Scattered, Wrong::Mirrored];
        let kind = options.wrong.unwrap_or(kinds[k % kinds.len()]);
        let jitter = std::array::from_fn(|_| rng.normal());
        let seen = seen_indices(&car.keypoints_in_car, &camera_from_car, options.seen, &jitter);
        let sd_px = options.noise * car.box_px;
        let claimed = if options.noise > 0.0 { sd_px } else { CLAIMED_NOISE * car.box_px };
        let pose = if car.wrong && kind == Wrong::OtherPose {
            other_pose(&camera_from_car, rng)
        } else {
            off_view(&camera_from_car, &(camera_from_world * Vector3::z()), options, rng)
        };
        let origin = camera.pixel_from_camera(&(camera_from_car * Point3::new(0.0, 0.0, 0.7)).coords);
        for index in seen {
            let scattered = Vector2::new(rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6)) * car.box_px;
            let outlier = rng.unit() < options.outliers;
            let source = if car.wrong && kind == Wrong::Mirrored { mirror_index(index) } else { index };
            let pixel = camera.pixel_from_camera(&(pose * Point3::from(car.keypoints_in_car[source])).coords);
            let scatter = outlier || (car.wrong && kind == Wrong::Scattered);
            let pixel = if scatter { origin.map(|o| o + scattered) } else { pixel };
            let noise = Vector2::new(rng.normal(), rng.normal()) * sd_px;
            car.keypoints[index] = pixel.map(|p| Keypoint::isotropic(p + noise, 1.0, claimed));
            car.outlier[index] = outlier && !car.wrong;
        }
    }
}

/// Returns the indices of the visible keypoints, in rising order. The visible keypoints are those that face the camera
/// most. Their share of all keypoints is `share`.
///
/// `jitter` are standard normal numbers. They decide between keypoints that face the camera almost equally.
pub(crate) fn seen_indices(
    keypoints_in_car: &[Vector3<f64>; KEYPOINTS],
    camera_from_car: &Isometry3<f64>,
    share: f64,
    jitter: &[f64; KEYPOINTS],
) -> Vec<usize> {
    let eye_in_car = camera_from_car.inverse() * Point3::origin();
    let middle = Vector3::new(0.0, 0.0, 0.7);
    let mut ranked: Vec<(f64, usize)> = (0..KEYPOINTS)
        .map(|i| {
            let outward = (keypoints_in_car[i] - middle).component_div(&Vector3::new(2.2, 0.9, 0.8));
            let towards = eye_in_car.coords - keypoints_in_car[i];
            (outward.dot(&towards) / towards.norm().max(1e-9) + 0.15 * jitter[i], i)
        })
        .collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let count = (share * KEYPOINTS as f64).round() as usize;
    let mut indices: Vec<usize> = ranked.into_iter().take(count).map(|(_, i)| i).collect();
    indices.sort_unstable();
    indices
}

/// Returns the car's pose rotated by a view error, as a keypoint net would see the car. The crate `solve` models the
/// same error (`problem/cars/joint.rs`). `up` is the ground's normal in the camera frame.
fn off_view(
    camera_from_car: &Isometry3<f64>,
    up: &Vector3<f64>,
    options: &SynthOptions,
    rng: &mut Rng,
) -> Isometry3<f64> {
    if options.view_off == [0.0; 2] && options.view_sd == [0.0; 2] {
        return *camera_from_car;
    }
    let ray = camera_from_car.translation.vector;
    let axes = [ray.cross(up), ray];
    let mut pose = *camera_from_car;
    for ((axis, off), sd) in axes.iter().zip(options.view_off).zip(options.view_sd) {
        let angle = off + sd * rng.normal();
        if let Some(axis) = Unit::try_new(*axis, 1e-9) {
            pose.rotation = UnitQuaternion::from_axis_angle(&axis, angle) * pose.rotation;
        }
    }
    pose
}

/// Returns a pose in the same direction from the camera, but with a random rotation and another distance.
fn other_pose(camera_from_car: &Isometry3<f64>, rng: &mut Rng) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(rng.normal(), rng.normal(), rng.normal()));
    let nearer = rng.uniform(0.8, 1.25);
    let mut pose = *camera_from_car;
    pose.rotation = turn * pose.rotation;
    pose.translation.vector *= nearer;
    pose
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;
    use roadplane_base::ShapeAtlas;

    #[test]
    fn a_scene_follows_its_options() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let options = SynthOptions { noise: 0.02, ..SynthOptions::default() };
        let (mut square, mut count) = (0.0, 0.0);
        for seed in 0..20 {
            let truth = scene(&atlas, &options, seed);
            assert_eq!(truth.cars.len(), 10);
            let camera = Camera::centred(truth.params.focal_px(), truth.size);
            let camera_from_world = truth.params.plane().camera_from_world();
            for car in &truth.cars {
                assert_eq!(car.keypoints.iter().flatten().count(), 22);
                let camera_from_car = camera_from_world * car.pose.world_from_car();
                for (point, keypoint) in car.keypoints_in_car.iter().zip(&car.keypoints) {
                    let Some(keypoint) = keypoint else { continue };
                    let pixel =
                        camera.pixel_from_camera(&(camera_from_car * Point3::from(*point)).coords).unwrap();
                    square += (pixel - keypoint.pixel).norm_squared() / (0.02 * car.box_px).powi(2);
                    count += 2.0;
                }
            }
            let again = scene(&atlas, &options, seed);
            assert_eq!(again.cars[3].keypoints, truth.cars[3].keypoints);
        }
        assert!((square / count - 1.0_f64).abs() < 0.05, "{}", square / count);
    }

    #[test]
    fn a_view_error_shows_cars_from_another_elevation() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let asked = |view_off| SynthOptions { noise: 0.0, cars: 4, view_off, ..SynthOptions::default() };
        let [right, off] = [[0.0, 0.0], [0.05, 0.0]].map(|view_off| scene(&atlas, &asked(view_off), 5));
        for (car, seen) in right.cars.iter().zip(&off.cars) {
            assert_eq!(car.pose, seen.pose);
            let height = |of: &crate::CarTruth| {
                let ys = of.keypoints.iter().flatten().map(|k| k.pixel.y);
                let (low, high) = ys.fold((f64::MAX, f64::MIN), |(l, h), y| (l.min(y), h.max(y)));
                high - low
            };
            let change = (height(seen) / height(car) - 1.0).abs();
            assert!(change > 1e-3 && change < 0.3, "{change}");
        }
    }

    #[test]
    fn outliers_and_wrong_cars_are_marked() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let options = SynthOptions { outliers: 0.2, wrong_cars: 0.2, cars: 10, ..SynthOptions::default() };
        let truth = scene(&atlas, &options, 3);
        assert_eq!(truth.cars.iter().filter(|car| car.wrong).count(), 2);
        let share = truth.cars.iter().flat_map(|car| &car.outlier).filter(|o| **o).count();
        assert!((15..55).contains(&share), "{share} of 176");
    }
}
