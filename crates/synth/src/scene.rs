//! Creates random scenes: a camera, a ground plane and cars.

use nalgebra::{Point3, Vector2, Vector3};
use roadplane_base::{
    Camera, CameraParams, FINE_MODES, GroundPlane, GroundPose, KEYPOINTS, MODES, Shape, ShapeAtlas,
};

use crate::models::{draw, draw_shape, move_off_atlas};
use crate::truth::{CarTruth, Layout, SceneTruth, SynthOptions};
use crate::{Rng, keypoints};

/// Largest number of random cameras that are tried for the requested number of cars. If all fail, the scene with the
/// most cars is used.
const CAMERA_TRIES: usize = 200;
/// Number of random positions that are tried per camera, for each requested car.
const POSITION_TRIES: usize = 40;
/// Least distance between the centres of two cars that are not in a row, m.
const MIN_GAP_M: f64 = 5.2;
/// Distance between neighbouring cars in a row, m.
const BAY_M: f64 = 2.7;

/// Creates a random scene. With very tight options, the scene has fewer cars than requested.
#[must_use]
pub fn scene(atlas: &ShapeAtlas, options: &SynthOptions, seed: u64) -> SceneTruth {
    let mut rng = Rng::new(seed);
    let mut best: Option<SceneTruth> = None;
    for _ in 0..CAMERA_TRIES {
        let truth = sample_scene(atlas, options, &mut rng);
        let full = truth.cars.len() >= options.cars;
        if best.as_ref().is_none_or(|b| truth.cars.len() > b.cars.len()) {
            best = Some(truth);
        }
        if full {
            break;
        }
    }
    let mut truth = best.unwrap_or_else(|| sample_scene(atlas, options, &mut rng));
    keypoints::measure(&mut truth, options, &mut rng);
    truth
}

fn camera(options: &SynthOptions, rng: &mut Rng) -> (Camera, GroundPlane) {
    let [low, high] = options.focal_ratio.map(f64::ln);
    let focal_px = f64::from(options.size.width) * rng.uniform(low, high).exp();
    let mut range = |[low, high]: [f64; 2]| rng.uniform(low, high);
    let (tilt, roll, height_m) = (range(options.tilt), range(options.roll), range(options.height_m));
    (Camera::centred(focal_px, options.size), GroundPlane::from_tilt_roll_height(tilt, roll, height_m))
}

fn sample_scene(atlas: &ShapeAtlas, options: &SynthOptions, rng: &mut Rng) -> SceneTruth {
    let (camera, plane) = camera(options, rng);
    let mut truth = SceneTruth {
        size: options.size,
        params: CameraParams::new(camera.focal_px, &plane),
        cars: Vec::new(),
    };
    let axis = match options.layout {
        Layout::OneRow => std::f64::consts::FRAC_PI_2 + 0.1 * rng.normal(),
        _ => rng.uniform(-std::f64::consts::PI, std::f64::consts::PI),
    };
    let mut row: Option<GroundPose> = None;
    for _ in 0..options.cars * POSITION_TRIES {
        if truth.cars.len() >= options.cars {
            break;
        }
        let pose = candidate(options, &camera, &plane, axis, row, truth.cars.len(), rng);
        let Some(pose) = pose else {
            row = None;
            continue;
        };
        let body = body(atlas, options, rng);
        if let Some(car) = placed_car(atlas, options, &camera, &plane, &truth, pose, &body, rng) {
            truth.cars.push(car);
            row = matches!(options.layout, Layout::Rows | Layout::OneRow).then_some(pose);
        } else if options.layout == Layout::Rows {
            row = None;
        }
    }
    truth
}

/// Shape of a car, and its keypoints in the car frame (m).
type Body = (Shape, [Vector3<f64>; KEYPOINTS]);

pub(crate) fn body(atlas: &ShapeAtlas, options: &SynthOptions, rng: &mut Rng) -> Body {
    if let Some(model) = draw(&options.models, rng) {
        return (model.nearest_shape(atlas), model.keypoints_in_car);
    }
    if options.off_atlas > 0.0 {
        let mut all = draw_shape(atlas, rng) * options.shape_sd;
        let shape = atlas.clamped(&all.fixed_rows::<MODES>(0).into_owned());
        all.fixed_rows_mut::<MODES>(0).copy_from(&shape);
        all.fixed_rows_mut::<FINE_MODES>(MODES).apply(|coefficient| *coefficient *= options.off_atlas);
        return (shape, std::array::from_fn(|i| atlas.keypoint_of_all_modes(i, &all)));
    }
    let shape = atlas.clamped(&Shape::from_fn(|_, _| options.shape_sd * rng.normal()));
    (shape, atlas.keypoints_in_car(&shape))
}

fn candidate(
    options: &SynthOptions,
    camera: &Camera,
    plane: &GroundPlane,
    axis: f64,
    row: Option<GroundPose>,
    index: usize,
    rng: &mut Rng,
) -> Option<GroundPose> {
    if let Some(last) = row {
        // The next car is beside the previous car. In the layout `OneRow` it may be on either side.
        let side = if options.layout == Layout::OneRow && rng.unit() < 0.5 { -1.0 } else { 1.0 };
        let step = side * BAY_M * (1.0 + (rng.unit() * 3.0).floor());
        let flip =
            if options.layout == Layout::Rows && rng.unit() < 0.3 { std::f64::consts::PI } else { 0.0 };
        let (sin, cos) = axis.sin_cos();
        return Some(GroundPose {
            x_m: last.x_m - sin * step,
            y_m: last.y_m + cos * step,
            heading_rad: roadplane_base::wrap_angle(axis + flip + 0.03 * rng.normal()),
        });
    }
    if options.layout == Layout::OneRow && index > 0 {
        return None;
    }
    let (w, h) = (f64::from(options.size.width), f64::from(options.size.height));
    let pixel = Vector2::new(rng.uniform(0.03, 0.97) * w, rng.uniform(0.05, 0.97) * h);
    let at = plane.world_from_pixel(camera, &pixel)?;
    let heading_rad = match options.layout {
        Layout::Random => rng.uniform(-std::f64::consts::PI, std::f64::consts::PI),
        _ => roadplane_base::wrap_angle(axis + 0.03 * rng.normal()),
    };
    Some(GroundPose { x_m: at.x, y_m: at.y, heading_rad })
}

/// Returns a car at the given pose. Returns `None` if the car is partly outside the image, has another size than
/// requested, or is too close to another car.
#[expect(clippy::too_many_arguments)]
fn placed_car(
    atlas: &ShapeAtlas,
    options: &SynthOptions,
    camera: &Camera,
    plane: &GroundPlane,
    truth: &SceneTruth,
    pose: GroundPose,
    (shape, keypoints_in_car): &Body,
    rng: &mut Rng,
) -> Option<CarTruth> {
    let gap = match options.layout {
        Layout::Rows | Layout::OneRow => BAY_M * 0.95,
        _ => MIN_GAP_M,
    };
    let clear = |other: &CarTruth| (other.pose.x_m - pose.x_m).hypot(other.pose.y_m - pose.y_m) > gap;
    if !truth.cars.iter().all(clear) {
        return None;
    }
    let mut keypoints_in_car = *keypoints_in_car;
    move_off_atlas(&mut keypoints_in_car, atlas, options.off_atlas, rng);
    let camera_from_car = plane.camera_from_world() * pose.world_from_car();
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    for point in &keypoints_in_car {
        let pixel = camera.pixel_from_camera(&(camera_from_car * Point3::from(*point)).coords)?;
        low = low.inf(&pixel);
        high = high.sup(&pixel);
    }
    let box_px = (high - low).max();
    let inside = low.min() >= 0.0
        && high.x <= f64::from(options.size.width) - 1.0
        && high.y <= f64::from(options.size.height) - 1.0;
    let fits = inside && (options.box_px[0]..=options.box_px[1]).contains(&box_px);
    debug_assert_eq!(MODES, shape.len());
    fits.then_some(CarTruth {
        pose,
        shape: *shape,
        keypoints_in_car,
        keypoints: [None; KEYPOINTS],
        outlier: [false; KEYPOINTS],
        wrong: false,
        box_px,
    })
}
