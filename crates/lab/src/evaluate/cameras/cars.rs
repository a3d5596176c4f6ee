//! Single cars before a known camera: the view of them that is fitted against the true one, and where their keypoints lie.

use nalgebra::{Isometry3, Vector2, Vector3};
use roadplane_base::{Camera, FrameRecord, KEYPOINTS, KeypointSet, ShapeAtlas, StudentT};
use roadplane_pipeline::{Config, usable};
use roadplane_solve::{ShapePrior, fit_car, fit_free_car};

use roadplane_metrics::readers::cameras::ReferenceCamera;

/// From which side a car is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Aspect {
    Front,
    FrontOblique,
    Side,
    RearOblique,
    Rear,
}

impl Aspect {
    pub const ALL: [Self; 5] = [Self::Front, Self::FrontOblique, Self::Side, Self::RearOblique, Self::Rear];

    pub fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::FrontOblique => "front, oblique",
            Self::Side => "side",
            Self::RearOblique => "rear, oblique",
            Self::Rear => "rear",
        }
    }

    /// By the angle between where the car points and where it is seen from, laid on the ground, rad.
    fn of(angle: f64) -> Self {
        match angle.to_degrees() {
            a if a < 25.0 => Self::Front,
            a if a < 65.0 => Self::FrontOblique,
            a if a < 115.0 => Self::Side,
            a if a < 155.0 => Self::RearOblique,
            _ => Self::Rear,
        }
    }
}

/// A keypoint found, against the car fitted before the true camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct PointOff {
    pub index: usize,
    /// Found minus fitted, right and up in the picture, in units of the box's longer side.
    pub off: Vector2<f64>,
    /// Whether the net takes it for visible.
    pub visible: bool,
}

/// A car that was fitted.
#[derive(Clone, Debug)]
pub(super) struct SeenCar {
    pub box_px: f64,
    pub aspect: Aspect,
    /// True angle at which it is seen from above, rad.
    pub elevation: f64,
    /// With the pose free: elevation, turn about the line of sight (positive: clockwise), rad; log of how high the camera stands
    /// above its ground.
    pub errors: [f64; 3],
    /// sds of the first two, keypoints taken for independent, how they fit the car on the ground counted, rad.
    pub claimed: [f64; 2],
    /// With the car on the true ground.
    pub points: Vec<PointOff>,
}

/// The cars of a picture.
pub(super) fn cars_of(
    known: &ReferenceCamera,
    frame: &FrameRecord,
    atlas: &ShapeAtlas,
    config: &Config,
) -> Vec<SeenCar> {
    let seen = |car: &roadplane_base::CarRecord| {
        let keypoints = usable(car.keypoints.as_deref()?, config);
        seen_car(known, &keypoints, car.longer_side_px(), atlas, config)
    };
    frame.cars.iter().filter_map(seen).collect()
}

fn seen_car(
    known: &ReferenceCamera,
    keypoints: &KeypointSet,
    box_px: f64,
    atlas: &ShapeAtlas,
    config: &Config,
) -> Option<SeenCar> {
    let options = config.solve.scene_options(None);
    let camera = known.camera();
    let up = known.plane.normal_in_camera;
    let free = fit_free_car(atlas, &camera, keypoints, &options)?;
    let place = free.camera_from_car.translation.vector;
    let sight = place.try_normalize(1e-9)?;
    let own_up = free.camera_from_car * Vector3::z();
    let elevation = |up: &Vector3<f64>| (-up.dot(&sight)).clamp(-1.0, 1.0).asin();
    // Ups laid across the line of sight, which points away from the camera.
    let across = |up: &Vector3<f64>| (up - sight * up.dot(&sight)).try_normalize(1e-9);
    let [own, truth] = [across(&own_up)?, across(&up)?];
    let turn = truth.cross(&own).dot(&sight).atan2(truth.dot(&own));
    let height = -own_up.dot(&place);
    let errors = [elevation(&own_up) - elevation(&up), turn, (height / known.plane.height_m).ln()];
    // Turns of the car about the axes that its elevation and its turn are about.
    let turns = free.pose_covariance.fixed_view::<3, 3>(0, 0).into_owned();
    let axes = [sight.cross(&own_up).try_normalize(1e-9)?, sight];

    let fit = fit_car(atlas, &camera, &known.plane, keypoints, &ShapePrior::default(), None, &options)?;
    let numbers = 2.0 * keypoints.iter().flatten().count() as f64;
    let worth = StudentT { dimensions: numbers }.weight(2.0 * fit.cost);
    let claimed = axes.map(|axis| (axis.dot(&(turns * axis)).max(0.0) / worth).sqrt());
    let stood = fit.car;
    let pose = stood.camera_from_car;
    let towards = pose.inverse().translation.vector.xy();
    let points = points_off(&camera, &pose, keypoints, box_px, |i| atlas.keypoint_in_car(i, &stood.shape));
    Some(SeenCar {
        box_px,
        aspect: Aspect::of(towards.y.atan2(towards.x).abs()),
        elevation: elevation(&up),
        errors,
        claimed,
        points,
    })
    .filter(|car| car.errors.iter().all(|error| error.is_finite()))
}

fn points_off(
    camera: &Camera,
    camera_from_car: &Isometry3<f64>,
    keypoints: &KeypointSet,
    box_px: f64,
    point_in_car: impl Fn(usize) -> Vector3<f64>,
) -> Vec<PointOff> {
    let off = |index: usize| {
        let found = keypoints[index].as_ref()?;
        let point = camera_from_car * nalgebra::Point3::from(point_in_car(index));
        let off = (found.pixel - camera.pixel_from_camera(&point.coords)?) / box_px;
        Some(PointOff { index, off: Vector2::new(off.x, -off.y), visible: found.score >= 0.5 })
    };
    (0..KEYPOINTS).filter_map(off).collect()
}
