use nalgebra::Point3;
use roadplane_base::{Camera, CameraParams, Factor, GroundPose};
use roadplane_calibrate::{CarHeading, Parallel, parallel};
use roadplane_synth::Rng;

/// True focal length, px.
const FOCAL_PX: f64 = 1500.0;
/// Sd of a car's heading, beside the error that the method itself assumes, rad.
const SD: f64 = 0.015;
/// Sd of log focal length from poses; it is poor.
const POSES: f64 = 0.5;

/// Returns the true camera.
fn truth() -> CameraParams {
    CameraParams { log_focal: FOCAL_PX.ln(), tilt: 0.2, roll: 0.02, log_height: 8f64.ln() }
}

/// Returns the heading of a car after a solve whose focal length is wrong by the factor `ratio`.
///
/// The horizon of the solve is right. The car's turn relative to the ray to it is right up to `noise`, rad.
fn solved(link: u64, pose: GroundPose, ratio: f64, noise: f64) -> CarHeading {
    let truth = truth();
    let focal_px = FOCAL_PX * ratio;
    let tilt = (truth.tilt.tan() / ratio).atan();
    let wrong = CameraParams { log_focal: focal_px.ln(), tilt, ..truth };
    let seen = truth.plane().camera_from_world() * Point3::new(pose.x_m, pose.y_m, 0.0);
    let pixel = FOCAL_PX * seen.coords.xy() / seen.z;
    let camera = Camera::pinhole(focal_px, nalgebra::Vector2::zeros());
    let place = wrong.plane().world_from_pixel(&camera, &pixel).unwrap();
    let turned = pose.x_m.atan2(pose.y_m) - place.x.atan2(place.y);
    let heading_rad = pose.heading_rad + turned + noise;
    CarHeading::new(link, &wrong, &GroundPose { x_m: place.x, y_m: place.y, heading_rad }, SD).unwrap()
}

/// Returns the car with the identifier `link`.
fn named(mut car: CarHeading, link: u64) -> CarHeading {
    car.link = link;
    car
}

/// Returns the estimated focal length and its sd, px.
fn told(found: &Parallel) -> [f64; 2] {
    let Factor::InverseFocal { per_px, sd } = found.factor else { panic!("{found:?}") };
    [1.0 / per_px, sd / per_px / per_px]
}

/// Returns cars on a street whose direction changes by `bend` rad/m.
fn street(seed: u64, count: u64, ratio: f64, heading: f64, bend: f64, noise: f64) -> Vec<CarHeading> {
    let mut random = Rng::new(seed);
    // The net itself turns parallel cars into a fan.
    let own_fan = if noise > 0.0 { 0.05 * random.normal() } else { 0.0 };
    let cars = (0..count).map(|link| {
        let y_m = random.uniform(20.0, 60.0);
        let x_m = random.uniform(-0.45, 0.45) * y_m;
        let along = heading.cos() * x_m + heading.sin() * (y_m - 40.0);
        let pose = GroundPose { x_m, y_m, heading_rad: heading + bend * along };
        solved(link, pose, ratio, noise * random.normal() + own_fan * x_m.atan2(y_m))
    });
    cars.collect()
}

#[test]
fn parallel_cars_tell_the_focal_length_they_were_not_solved_with() {
    for (seed, ratio) in [(1, 0.85), (2, 1.0), (3, 1.2)] {
        let mut cars = street(seed, 12, ratio, 1.3, 0.0, 0.0);
        cars.extend(
            street(seed + 50, 8, ratio, 1.3 - std::f64::consts::PI, 0.0, 0.0)
                .into_iter()
                .map(|car| named(car, car.link + 100)),
        );
        let found = parallel(&cars, POSES).unwrap();
        let [focal_px, sd_px] = told(&found);
        assert_eq!(found.cars, 20);
        assert!((focal_px / FOCAL_PX - 1.0).abs() < 0.02, "{focal_px} from {ratio}");
        assert!((0.01..0.1).contains(&(sd_px / focal_px)), "{sd_px}");
    }
}

#[test]
fn they_know_how_well_they_tell_it() {
    // The scatter of cars and of the net together, on streets with curvature.
    let noise = 0.026f64.hypot(SD);
    let (mut squares, count) = (0.0, 200);
    for seed in 0..count {
        let bend = 0.002 * Rng::new(900 + seed).normal();
        let found = parallel(&street(seed, 10, 1.0, 1.5, bend, noise), POSES).unwrap();
        let Factor::InverseFocal { per_px, sd } = found.factor else { panic!("{found:?}") };
        squares += ((per_px - 1.0 / FOCAL_PX) / sd).powi(2);
    }
    let in_sds = (squares / count as f64).sqrt();
    println!("error / sd {in_sds}");
    assert!((0.8..1.25).contains(&in_sds), "error / sd {in_sds}");
}

#[test]
fn one_that_turns_off_changes_little() {
    let mut cars = street(5, 12, 1.0, 1.4, 0.0, 0.0);
    let [whole, sd] = told(&parallel(&cars, POSES).unwrap());
    cars.push(solved(70, GroundPose { x_m: 14.0, y_m: 35.0, heading_rad: 1.4 + 0.16 }, 1.0, 0.0));
    let [with, _] = told(&parallel(&cars, POSES).unwrap());
    assert!((with - whole).abs() < 0.7 * sd, "{whole} → {with}, sd {sd}");
}

#[test]
fn poses_that_tell_more_are_left_alone() {
    let beside = |link: u64| {
        solved(link, GroundPose { x_m: 3.0 * link as f64 - 3.0, y_m: 30.0, heading_rad: 1.4 }, 1.0, 0.0)
    };
    let few: Vec<CarHeading> = (0..3).map(beside).collect();
    let [focal_px, sd_px] = told(&parallel(&few, POSES).unwrap());
    assert!(parallel(&few, 1.01 * sd_px / focal_px).is_some());
    assert_eq!(parallel(&few, 0.99 * sd_px / focal_px), None);
}

#[test]
fn a_car_that_is_seen_again_is_no_other_car() {
    let cars = street(8, 10, 1.0, 1.4, 0.0, 0.01);
    let again: Vec<CarHeading> = cars.iter().chain(&cars).chain(&cars).copied().collect();
    assert_eq!(parallel(&again, POSES), parallel(&cars, POSES));
}

#[test]
fn few_cars_or_cars_in_one_direction_of_sight_say_nothing() {
    assert_eq!(parallel(&[], POSES), None);
    assert_eq!(parallel(&street(1, 2, 1.0, 1.4, 0.0, 0.0), POSES), None);
    let behind = |link: u64| {
        let y_m = 20.0 + 8.0 * link as f64;
        solved(link, GroundPose { x_m: 0.05 * y_m, y_m, heading_rad: 1.4 }, 1.0, 0.0)
    };
    let column: Vec<CarHeading> = (0..6).map(behind).collect();
    assert_eq!(parallel(&column, POSES), None);
    let across: Vec<CarHeading> = (0..9)
        .flat_map(|i: u32| street(u64::from(i), 1, 1.0, 0.7 * f64::from(i), 0.0, 0.0))
        .zip(0..)
        .map(|(car, link)| named(car, link))
        .collect();
    assert_eq!(parallel(&across, POSES), None, "no two of them point the same way");
}
