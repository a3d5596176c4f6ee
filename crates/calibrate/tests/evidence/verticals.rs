use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};
use roadplane_base::{
    Camera, CameraEstimate, CameraParams, CameraStatus, ImageSize, JointInformation, Lens, SceneLine,
};
use roadplane_calibrate::{
    Factor, FuseOptions, VerticalVanishingPoint, Verticals, WindowEstimate, fuse, verticals,
};
use roadplane_synth::Rng;

/// Size of the simulated pictures, px.
const SIZE: ImageSize = ImageSize { width: 1920, height: 1080 };
/// Claimed sds of the cars: log focal length, horizon (as a share of it), roll (rad), log height.
const CLAIMED: [f64; 4] = [0.19, 0.02, 0.006, 0.05];

/// A camera, the lines of its picture, and the estimate from cars.
struct Scene {
    /// True (log focal length, tilt, roll, log height) relative to the road.
    truth: Vector4<f64>,
    /// True inverse distance of the vertical vanishing point, relative to gravity, 1/px.
    inverse_distance: f64,
    /// True roll relative to gravity, rad.
    roll: f64,
    /// Lines of the picture, longest first.
    lines: Vec<SceneLine>,
    /// Camera from cars.
    cars: CameraEstimate,
}

/// Returns a scene with vertical objects (each with up to four edges), stray edges, and edges of lanes.
fn scene(seed: u64, things: usize, strays: usize, lanes: usize) -> Scene {
    let mut random = Rng::new(seed);
    let mut normal = |sd: f64| sd * random.normal();
    let log_focal = (1920f64 * 1.2).ln() + normal(0.4).clamp(-0.7, 0.7);
    let tilt = 0.3 + normal(0.12).clamp(-0.2, 0.3);
    let roll = normal(0.03);
    let from_gravity =
        (tilt + normal(VerticalVanishingPoint::SLOPE_SD), roll + normal(VerticalVanishingPoint::SLOPE_SD));
    let (focal, height) = (log_focal.exp(), 8f64);
    let inverse_distance = from_gravity.0.tan() / focal;
    let lens = (960.0 / focal).powi(2) * (-0.12 + normal(0.15));
    // The cars are off along the horizon by the error that they share and claim, and by a little of the horizon.
    let seen_log_focal = log_focal + normal(CLAIMED[0]);
    let horizon = focal * tilt.tan() * (1.0 + normal(CLAIMED[1]));
    let params = CameraParams {
        log_focal: seen_log_focal,
        tilt: (horizon / seen_log_focal.exp()).atan(),
        roll: roll + normal(CLAIMED[2]),
        log_height: height.ln() + normal(CLAIMED[3]),
    };
    let along = Vector4::new(1.0, -params.tilt.sin() * params.tilt.cos(), 0.0, 0.0) * CLAIMED[0];
    let rest = [0.0, CLAIMED[1] * params.tilt.sin() * params.tilt.cos(), CLAIMED[2], CLAIMED[3]];
    let covariance =
        along * along.transpose() + Matrix4::from_diagonal(&Vector4::from(rest).map(|sd| sd * sd));
    let cars = CameraEstimate {
        span_s: [0.0; 2],
        image_size_px: SIZE,
        principal_point_px: SIZE.centre_px(),
        lens: Lens::STRAIGHT,
        distortion_sd: None,
        params,
        covariance,
        status: CameraStatus::Estimated,
        cars_used: 5,
        frames_used: 1,
        second_plane: None,
    };
    let middle =
        SIZE.centre_px() + Camera::PRINCIPAL_POINT_SD * 1920.0 * Vector2::new(normal(1.0), normal(1.0));
    let mut lines = Vec::new();
    let mut add = |random: &mut Rng, at: Vector2<f64>, along: Vector2<f64>| {
        let length = random.uniform(30.0, 160.0);
        let sd_rad = 20.0 / (length * length);
        let (sin, cos) = (sd_rad * random.normal()).sin_cos();
        let along = Vector2::new(cos * along.x - sin * along.y, sin * along.x + cos * along.y) / along.norm();
        // The lens moves the ends, and with them the midpoint.
        let ends = [-0.5, 0.5].map(|share| at + share * length * along);
        let distorted = ends.map(|end| end * (1.0 + lens * end.norm_squared() / (960.0 * 960.0)) + middle);
        if (along.x / along.y).abs() < 0.57 {
            lines.push(SceneLine { ends_px: distorted, sd_rad });
        }
    };
    let anywhere =
        |random: &mut Rng| Vector2::new(random.uniform(-900.0, 900.0), random.uniform(-500.0, 500.0));
    for _ in 0..things {
        let at = anywhere(&mut random);
        let lean = 0.0087 * random.normal();
        for _ in 0..1 + (random.unit() * 4.0) as usize {
            let at = at + Vector2::new(random.uniform(-15.0, 15.0), random.uniform(-15.0, 15.0));
            let along = Vector2::new((from_gravity.1 + lean).sin(), -(from_gravity.1 + lean).cos())
                + inverse_distance * at;
            add(&mut random, at, along);
        }
    }
    for _ in 0..strays {
        let at = anywhere(&mut random);
        let angle = random.uniform(-0.5, 0.5);
        add(&mut random, at, Vector2::new(angle.sin(), angle.cos()));
    }
    let vanishing = Vector2::new(random.uniform(-500.0, 500.0), -focal * tilt.tan());
    for _ in 0..lanes {
        let at = anywhere(&mut random);
        if at.y > vanishing.y + 50.0 {
            add(&mut random, at, at - vanishing);
        }
    }
    lines.sort_by(|a, b| b.along_px().norm().total_cmp(&a.along_px().norm()));
    lines.truncate(120);
    Scene {
        truth: Vector4::new(log_focal, tilt, roll, height.ln()),
        inverse_distance,
        roll: from_gravity.1,
        lines,
        cars,
    }
}

/// Returns the squared error of (`inverse_distance`, roll), in sds.
fn distance(scene: &Scene, found: &Verticals) -> f64 {
    let VerticalVanishingPoint { inverse_distance, roll, covariance } = found.factor;
    let off = Vector2::new(inverse_distance - scene.inverse_distance, roll - scene.roll);
    off.dot(&(covariance.try_inverse().unwrap() * off))
}

#[test]
fn masts_tell_where_up_is_and_how_well() {
    let scenes: Vec<Scene> = (0..60).map(|seed| scene(seed, 25, 25, 12)).collect();
    let found: Vec<(f64, &Scene)> = scenes
        .iter()
        .filter_map(|scene| Some((distance(scene, &verticals(&scene.lines, &scene.cars)?), scene)))
        .collect();
    assert!(found.len() >= 45, "{} of {} seen", found.len(), scenes.len());
    let in_sds = (found.iter().map(|(d, _)| d).sum::<f64>() / (2 * found.len()) as f64).sqrt();
    println!("{} of {} seen, error / sd {in_sds}", found.len(), scenes.len());
    assert!((0.8..1.25).contains(&in_sds), "error / sd {in_sds}");
}

#[test]
fn roads_without_vertical_edges_have_no_result() {
    let count = 80;
    let found_in = (0..count)
        .filter(|seed| {
            let scene = scene(1000 + seed, 0, 5 + (seed % 8) as usize * 5, (seed % 5) as usize * 12);
            verticals(&scene.lines, &scene.cars).is_some()
        })
        .count();
    println!("{found_in} of {count} have a result");
    assert!(found_in <= 1, "{found_in} of {count}");
    let scene = scene(7, 20, 0, 0);
    assert_eq!(verticals(&[], &scene.cars), None);
    let unknown = CameraEstimate { covariance: Matrix4::identity(), ..scene.cars };
    assert_eq!(verticals(&scene.lines, &unknown), None, "no horizon, no focal length");
}

#[test]
fn lines_correct_the_focal_length_along_the_horizon() {
    let (mut before, mut after, mut in_sds) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..60 {
        let scene = scene(2000 + seed, 25, 25, 12);
        let Some(found) = verticals(&scene.lines, &scene.cars) else { continue };
        let options = FuseOptions {
            factors: [(0, [Factor::Vertical(found.factor)].into())].into(),
            ..FuseOptions::for_image(SIZE)
        };
        let joined = &fuse(&[window(&scene.cars)], &options)[0];
        let horizon = |params: &CameraParams| params.focal_px() * params.tilt.tan();
        assert!((horizon(&joined.params) / horizon(&scene.cars.params) - 1.0).abs() < 0.12);
        let error = joined.params.log_focal - scene.truth[0];
        before.push((scene.cars.params.log_focal - scene.truth[0]).abs());
        after.push(error.abs());
        in_sds.push(error * error / joined.covariance[(0, 0)]);
    }
    let middle = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let (before, after) = (middle(&mut before), middle(&mut after));
    assert!(before > 0.09 && after < 0.05, "median error {before} → {after}");
    let in_sds = (in_sds.iter().sum::<f64>() / in_sds.len() as f64).sqrt();
    println!("median error {before} → {after}, error / sd {in_sds}");
    assert!((0.8..1.25).contains(&in_sds), "error / sd {in_sds}");
}

/// Returns a window with the estimate and covariance of the cars.
fn window(cars: &CameraEstimate) -> WindowEstimate {
    WindowEstimate {
        span_s: [0.0; 2],
        frames: 1,
        params: cars.params,
        joint: JointInformation::of_camera(&cars.covariance.try_inverse().unwrap(), &cars.params.to_vector()),
        cars: Vec::new(),
        position: 0,
    }
}

#[test]
fn a_street_that_may_be_steep_leaves_mean_and_covariance_of_both() {
    let sd = Vector4::new(0.06, 0.02, 0.012, 0.05);
    let truth = Vector4::new(1500f64.ln(), 0.25, 0.02, 8f64.ln());
    let information = Matrix4::from_diagonal(&sd.map(|sd| 1.0 / (sd * sd)));
    let cars = WindowEstimate {
        params: CameraParams::from_vector(&truth),
        joint: JointInformation::of_camera(&information, &truth),
        ..window(&CameraEstimate { covariance: Matrix4::identity(), ..scene(3, 0, 0, 0).cars })
    };
    // A level street and a steep one are about equally likely.
    let inverse_distance = (truth[1] + 0.057).tan() / 1500.0;
    let covariance = Matrix2::new(1e-12, 0.0, 0.0, 1e-6);
    let factor = Factor::Vertical(VerticalVanishingPoint { inverse_distance, roll: 0.02, covariance });
    let options =
        FuseOptions { factors: [(0, [factor.clone()].into())].into(), ..FuseOptions::for_image(SIZE) };
    let joined = &fuse(&[cars], &options)[0];
    let (mut total, mut sum, mut squares) = (0.0, Vector4::zeros(), Matrix4::zeros());
    let steps = 24;
    let at = |i: i32, number: usize| 4.5 * f64::from(i) / f64::from(steps) * sd[number];
    for (i, j, k) in (-steps..=steps)
        .flat_map(|i| (-steps..=steps).flat_map(move |j| (-steps..=steps).map(move |k| (i, j, k))))
    {
        let off = Vector4::new(at(i, 0), at(j, 1), at(k, 2), 0.0);
        let weight = (-0.5 * off.dot(&(information * off)) - factor.cost(&(truth + off)).unwrap()).exp();
        total += weight;
        sum += weight * off;
        squares += weight * off * off.transpose();
    }
    let mean = sum / total;
    let covariance = squares / total - mean * mean.transpose();
    for number in 0..3 {
        let found = joined.params.to_vector()[number] - truth[number];
        let (own, exact) = (joined.covariance[(number, number)].sqrt(), covariance[(number, number)].sqrt());
        assert!((found - mean[number]).abs() < 0.3 * exact, "{number}: {found}, exactly {}", mean[number]);
        assert!((own / exact - 1.0).abs() < 0.05, "{number}: sd {own}, exactly {exact}");
    }
}
