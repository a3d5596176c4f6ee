//! Synthetic clips of a fixed camera: cars drive, turn, halt, reverse and park among stationary cars.

use nalgebra::{Isometry3, Vector2};
use roadplane_base::{
    Camera, CameraParams, GroundPlane, KEYPOINTS, Keypoint, KeypointSet, ShapeAtlas, angle_difference,
};

use crate::Rng;
use crate::item::{CarInFrame, Item, ItemCar, projected};
use crate::keypoints::{CLAIMED_NOISE, seen_indices};
use crate::models::move_off_atlas;
use crate::scene::body;
use crate::traffic::{Aisle, Bay, Manoeuvre, drive, touch};
use crate::trajectory::{CarState, Drive};
use crate::truth::SynthOptions;

/// Least and largest length of a typical car in the middle of the picture, px.
const CAR_PX: [f64; 2] = [50.0, 120.0];
/// Length of a typical car, m.
const CAR_M: f64 = 4.3;
/// Least share of a car's box inside the picture. A frame leaves out cars with a smaller share.
const SMALLEST_SHARE: f64 = 0.3;
/// Number of random variants that are tried for each manoeuvre.
const TRIES: usize = 60;
/// Half the number of parking bays along each side of the aisle. The bays are numbered from −`BAYS` to `BAYS` − 1.
const BAYS: i32 = 4;
/// Share of a keypoint's error variance that stays constant while the car is stationary.
///
/// A net makes similar errors on the same view of the same car.
const LASTING: f64 = 0.8;
/// Distance of travel over which the slowly changing part of a keypoint's error decays to 1/e, m.
const FORGOTTEN_M: f64 = 2.0;

/// Options of a clip.
///
/// The field `scene` determines the car shapes, the keypoint errors, the ranges of the camera and the image size. Its
/// layout, number of cars, box sizes and wrong cars have no effect here.
#[derive(Clone, Debug)]
pub struct ClipOptions {
    /// Options for the camera, the shapes of the cars, and the measured keypoints.
    pub scene: SynthOptions,
    /// Duration of the clip, s.
    pub seconds: f64,
    /// Frame rate, 1/s.
    pub fps: f64,
    /// Number of moving cars.
    pub movers: usize,
    /// Number of parked cars.
    pub parked: usize,
}

impl Default for ClipOptions {
    fn default() -> Self {
        Self { scene: SynthOptions::default(), seconds: 12.0, fps: 10.0, movers: 5, parked: 5 }
    }
}

/// A car of the clip with its motion.
struct Actor {
    car: ItemCar,
    motion: Motion,
    jitter: [f64; KEYPOINTS],
}

enum Motion {
    Driving(Drive),
    Stationary(CarState),
}

impl Actor {
    fn at(&self, time_s: f64) -> CarState {
        match &self.motion {
            Motion::Driving(drive) => drive.at(time_s),
            Motion::Stationary(state) => *state,
        }
    }
}

/// Creates a clip. The clip has fewer cars than requested if the aisle has no room for more.
#[must_use]
pub fn clip_item(atlas: &ShapeAtlas, options: &ClipOptions, seed: u64) -> Item {
    let mut rng = Rng::new(seed);
    let (camera, plane, aisle) = camera_and_aisle(options, &mut rng);
    let actors = actors(atlas, options, &aisle, &mut rng);
    let camera_from_world = plane.camera_from_world();
    let count = (options.seconds * options.fps).round() as usize;
    let mut errors: Vec<Errors> = actors.iter().map(|actor| Errors::new(actor.at(0.0), &mut rng)).collect();
    let mut frames = Vec::with_capacity(count);
    for number in 0..count {
        let mut frame = Vec::new();
        for (id, (actor, errors)) in actors.iter().zip(&mut errors).enumerate() {
            let state = actor.at(number as f64 / options.fps);
            errors.advance(state, &mut rng);
            let camera_from_car = camera_from_world * state.pose.world_from_car();
            let view = projected(&camera, &camera_from_car, &actor.car.keypoints_in_car);
            let Some((pixels, whole_box)) = view else { continue };
            let keypoints = [None; KEYPOINTS];
            let mut in_frame = CarInFrame { id, state, pixels, whole_box, keypoints };
            in_frame.keypoints =
                measured(&in_frame, actor, &camera_from_car, errors, &options.scene, &mut rng);
            if in_frame.visible_box(options.scene.size).1 >= SMALLEST_SHARE {
                frame.push(in_frame);
            }
        }
        frames.push(frame);
    }
    Item {
        size: options.scene.size,
        params: CameraParams::new(camera.focal_px, &plane),
        fps: Some(options.fps),
        cars: actors.into_iter().map(|actor| actor.car).collect(),
        frames,
    }
}

/// Returns a random camera, its ground plane, and an aisle through the ground point in the middle of the picture. At
/// that point, the length of a typical car is within [`CAR_PX`].
fn camera_and_aisle(options: &ClipOptions, rng: &mut Rng) -> (Camera, GroundPlane, Aisle) {
    let scene = &options.scene;
    loop {
        let [low, high] = scene.focal_ratio.map(f64::ln);
        let focal_px = f64::from(scene.size.width) * rng.uniform(low, high).exp();
        let mut range = |[low, high]: [f64; 2]| rng.uniform(low, high);
        let (tilt, roll, height_m) = (range(scene.tilt), range(scene.roll), range(scene.height_m));
        let car_px = focal_px * CAR_M * tilt.sin() / height_m;
        let turned = rng.uniform(-std::f64::consts::PI, std::f64::consts::PI);
        let camera = Camera::centred(focal_px, scene.size);
        let plane = GroundPlane::from_tilt_roll_height(tilt, roll, height_m);
        let middle = plane.world_from_pixel(&camera, &camera.principal_point_px);
        // At a smaller distance, some parked cars would be below the camera.
        let far = middle.filter(|m| m.norm() > 18.0 && (CAR_PX[0]..=CAR_PX[1]).contains(&car_px));
        if let Some(origin) = far {
            return (camera, plane, Aisle { origin, heading: turned });
        }
    }
}

fn actors(atlas: &ShapeAtlas, options: &ClipOptions, aisle: &Aisle, rng: &mut Rng) -> Vec<Actor> {
    let mut bays: Vec<Bay> =
        (-BAYS..BAYS).flat_map(|number| [-1, 1].map(|side| Bay { number, side })).collect();
    shuffle(&mut bays, rng);
    let mut plan = vec![
        Manoeuvre::Park(bays[0]),
        Manoeuvre::UTurn,
        Manoeuvre::LeaveBackwards(bays[1]),
        Manoeuvre::TurnOff,
        Manoeuvre::Halt,
        Manoeuvre::ParkBackwards(bays[2]),
        Manoeuvre::LeaveForwards(bays[3]),
        Manoeuvre::TurnOff,
        Manoeuvre::Through,
    ];
    shuffle(&mut plan, rng);
    let mut actors: Vec<Actor> = Vec::new();
    let clear = |actors: &[Actor], actor: &Actor| {
        !actors.iter().any(|other| touch(&|t| other.at(t), &|t| actor.at(t), options.seconds))
    };
    for manoeuvre in plan {
        if actors.len() == options.movers {
            break;
        }
        let (car, wheelbase_m) = car(atlas, &options.scene, rng);
        for _ in 0..TRIES {
            let Some(drive) = drive(manoeuvre, aisle, wheelbase_m, options.seconds, rng) else { continue };
            let actor = actor(car.clone(), Motion::Driving(drive), rng);
            if clear(&actors, &actor) {
                actors.push(actor);
                break;
            }
        }
    }
    let mut stationary = 0;
    for bay in bays {
        if stationary == options.parked {
            break;
        }
        let (car, _) = car(atlas, &options.scene, rng);
        let mut pose = aisle.bay_pose(bay, rng.unit() < 0.3);
        pose.x_m += 0.1 * rng.normal();
        pose.y_m += 0.1 * rng.normal();
        pose.heading_rad += 0.02 * rng.normal();
        let actor = actor(car, Motion::Stationary(CarState::parked(pose)), rng);
        if clear(&actors, &actor) {
            actors.push(actor);
            stationary += 1;
        }
    }
    actors
}

fn actor(car: ItemCar, motion: Motion, rng: &mut Rng) -> Actor {
    Actor { car, motion, jitter: std::array::from_fn(|_| rng.normal()) }
}

/// Returns a random car and its wheelbase, m. The keypoints include a residual that the shape modes of the atlas do not
/// describe.
fn car(atlas: &ShapeAtlas, options: &SynthOptions, rng: &mut Rng) -> (ItemCar, f64) {
    let (shape, mut keypoints_in_car) = body(atlas, options, rng);
    move_off_atlas(&mut keypoints_in_car, atlas, options.off_atlas, rng);
    // Keypoints 0 and 1 are the front left wheel and the rear left wheel.
    let wheelbase_m = keypoints_in_car[0].x - keypoints_in_car[1].x;
    (ItemCar { keypoints_in_car, dims_m: atlas.dims_m(&shape) }, wheelbase_m)
}

fn shuffle<T>(items: &mut [T], rng: &mut Rng) {
    for i in (1..items.len()).rev() {
        items.swap(i, (rng.unit() * (i + 1) as f64) as usize);
    }
}

/// Slowly changing errors of a car's keypoints, in units of their sd. They are an autoregressive process over the
/// travelled distance.
struct Errors {
    unit: [Vector2<f64>; KEYPOINTS],
    last: CarState,
}

impl Errors {
    fn new(last: CarState, rng: &mut Rng) -> Self {
        Self { unit: std::array::from_fn(|_| normal(rng)), last }
    }

    fn advance(&mut self, state: CarState, rng: &mut Rng) {
        let (a, b) = (self.last.pose, state.pose);
        let turned = angle_difference(a.heading_rad, b.heading_rad).abs();
        let travelled = (a.x_m - b.x_m).hypot(a.y_m - b.y_m) + FORGOTTEN_M * turned;
        let kept = (-travelled / FORGOTTEN_M).exp();
        for error in &mut self.unit {
            *error = *error * kept + normal(rng) * (1.0 - kept * kept).sqrt();
        }
        self.last = state;
    }
}

fn normal(rng: &mut Rng) -> Vector2<f64> {
    Vector2::new(rng.normal(), rng.normal())
}

/// Returns the measured keypoints of a car, with noise and outliers. They are the keypoints that face the camera and
/// are inside the picture.
fn measured(
    in_frame: &CarInFrame,
    actor: &Actor,
    camera_from_car: &Isometry3<f64>,
    errors: &Errors,
    options: &SynthOptions,
    rng: &mut Rng,
) -> KeypointSet {
    let [x0, y0, x1, y1] = in_frame.whole_box;
    let box_px = (x1 - x0).max(y1 - y0);
    let claimed = if options.noise > 0.0 { options.noise } else { CLAIMED_NOISE } * box_px;
    let middle = Vector2::new(x0 + x1, y0 + y1) / 2.0;
    let (width, height) = (f64::from(options.size.width), f64::from(options.size.height));
    let mut keypoints = [None; KEYPOINTS];
    for index in seen_indices(&actor.car.keypoints_in_car, camera_from_car, options.seen, &actor.jitter) {
        let scattered = Vector2::new(rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6)) * box_px;
        let error = errors.unit[index] * LASTING.sqrt() + normal(rng) * (1.0 - LASTING).sqrt();
        let outlier = rng.unit() < options.outliers;
        let pixel = in_frame.pixels[index];
        let inside = pixel.x > -0.5 && pixel.y > -0.5 && pixel.x < width - 0.5 && pixel.y < height - 0.5;
        let found = if outlier { middle + scattered } else { pixel + error * (options.noise * box_px) };
        keypoints[index] = inside.then(|| Keypoint::isotropic(found, 1.0, claimed));
    }
    keypoints
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::Activity;

    #[test]
    fn clips_repeat_and_cars_do_not_touch() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let mut met = Vec::new();
        for seed in 0..8 {
            let options = ClipOptions { seconds: 10.0, fps: 5.0, ..ClipOptions::default() };
            let item = clip_item(&atlas, &options, seed);
            assert_eq!(item.frames.len(), 50);
            assert!(item.cars.len() >= 7, "{}", item.cars.len());
            let again = clip_item(&atlas, &options, seed);
            assert_eq!(item.frames[30].len(), again.frames[30].len());
            for (a, b) in item.frames[30].iter().zip(&again.frames[30]) {
                assert_eq!(a.keypoints, b.keypoints);
            }
            for frame in &item.frames {
                for (i, a) in frame.iter().enumerate() {
                    met.push(a.state.activity);
                    for b in &frame[..i] {
                        let (a, b) = (a.state.pose, b.state.pose);
                        assert!((a.x_m - b.x_m).hypot(a.y_m - b.y_m) > 1.9, "seed {seed}");
                    }
                }
            }
        }
        for wanted in [Activity::Parking, Activity::Reversing, Activity::UTurn, Activity::TurningLeft] {
            assert!(met.contains(&wanted), "{wanted:?}");
        }
    }

    #[test]
    fn errors_have_the_claimed_sd_and_last_while_a_car_is_stationary() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let scene = SynthOptions { noise: 0.02, ..SynthOptions::default() };
        let (mut square, mut count, mut apart, mut pairs) = (0.0, 0.0, 0.0, 0.0);
        for seed in 0..10 {
            let options =
                ClipOptions { scene: scene.clone(), seconds: 4.0, fps: 5.0, ..ClipOptions::default() };
            let item = clip_item(&atlas, &options, seed);
            let error =
                |s: &CarInFrame, k: usize| s.keypoints[k].map(|p| (p.pixel - s.pixels[k]) / p.sd_px());
            let (first, last) = (&item.frames[0], &item.frames[19]);
            for s in first {
                let same = last.iter().find(|l| l.id == s.id && l.state.pose == s.state.pose);
                for k in 0..KEYPOINTS {
                    let Some(e) = error(s, k) else { continue };
                    square += e.norm_squared();
                    count += 2.0;
                    if let Some(later) = same.and_then(|l| error(l, k)) {
                        apart += (e - later).norm_squared();
                        pairs += 2.0;
                    }
                }
            }
        }
        assert!((square / count - 1.0_f64).abs() < 0.08, "{}", square / count);
        // Between the two frames only the independent part of the error differs. The difference has twice a fifth of
        // the variance.
        assert!((apart / pairs - 0.4_f64).abs() < 0.06, "{}", apart / pairs);
    }
}
