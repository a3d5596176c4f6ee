//! Single cars in front of a reference camera: the errors of the fitted poses, and the offsets of the keypoints.

use nalgebra::{Isometry3, Vector2, Vector3};
use roadplane_base::{Camera, FrameRecord, KEYPOINTS, KeypointSet, ShapeAtlas, StudentT};
use roadplane_measure::usable;
use roadplane_pipeline::Config;
use roadplane_solve::{ShapePrior, fit_car, fit_free_car};

use roadplane_metrics::readers::cameras::ReferenceCamera;

/// The side of a car that the camera sees.
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

    /// Returns the aspect for the angle (rad) on the ground between the car's heading and the direction to the camera.
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

/// The offset of a found keypoint from the same keypoint of the car that was fitted with the true camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct PointOff {
    /// Index of the keypoint.
    pub index: usize,
    /// Found minus fitted position in the picture, in units of the longer side of the car's box: to the right and
    /// upwards.
    pub off: Vector2<f64>,
    /// Whether the net predicts that the keypoint is visible.
    pub visible: bool,
}

/// A car in front of a reference camera, with the errors of the fitted pose.
#[derive(Clone, Debug)]
pub(super) struct SeenCar {
    /// Longer side of the car's box, px.
    pub box_px: f64,
    pub aspect: Aspect,
    /// cos² of the angle on the ground between the car's heading and the direction to the camera.
    pub along: f64,
    /// True elevation: the angle above the horizontal from which the camera sees the car, rad.
    pub elevation: f64,
    /// Errors of the pose that is fitted without the ground plane.
    ///
    /// In order: elevation (rad), turn about the line of sight (rad, positive clockwise), and logarithm of the camera's
    /// height above the car's ground.
    pub errors: [f64; 3],
    /// Estimated sds of the elevation error and the turn error, rad.
    ///
    /// Keypoint errors count as independent. The sds are scaled by the misfit of the car that is fitted on the true
    /// ground.
    pub claimed: [f64; 2],
    /// Offsets of the found keypoints from the car that is fitted on the true ground.
    pub points: Vec<PointOff>,
}

/// Fits each car of a frame with the true camera. Cars that cannot be fitted are left out.
pub(super) fn cars_of(
    reference: &ReferenceCamera,
    frame: &FrameRecord,
    atlas: &ShapeAtlas,
    config: &Config,
) -> Vec<SeenCar> {
    let seen = |car: &roadplane_base::CarRecord| {
        let keypoints = usable(car.keypoints.as_deref()?, config.solve.min_keypoint_score);
        seen_car(reference, &keypoints, car.longer_side_px(), atlas, config)
    };
    frame.cars.iter().filter_map(seen).collect()
}

fn seen_car(
    reference: &ReferenceCamera,
    keypoints: &KeypointSet,
    box_px: f64,
    atlas: &ShapeAtlas,
    config: &Config,
) -> Option<SeenCar> {
    let options = config.solve.scene_options(None);
    let camera = reference.camera();
    let up = reference.plane.normal_in_camera;
    let free = fit_free_car(atlas, &camera, keypoints, &options)?;
    let position = free.camera_from_car.translation.vector;
    let ray = position.try_normalize(1e-9)?;
    let own_up = free.camera_from_car * Vector3::z();
    let elevation = |up: &Vector3<f64>| (-up.dot(&ray)).clamp(-1.0, 1.0).asin();
    // Projects an up vector onto the plane perpendicular to the line of sight `ray`, which points away from the camera.
    let across = |up: &Vector3<f64>| (up - ray * up.dot(&ray)).try_normalize(1e-9);
    let [own, truth] = [across(&own_up)?, across(&up)?];
    let turn = truth.cross(&own).dot(&ray).atan2(truth.dot(&own));
    let height = -own_up.dot(&position);
    let errors = [elevation(&own_up) - elevation(&up), turn, (height / reference.plane.height_m).ln()];
    // Covariance of small rotations of the car, and the axes of rotation for the elevation error and the turn error.
    let turns = free.pose_covariance.fixed_view::<3, 3>(0, 0).into_owned();
    let axes = [ray.cross(&own_up).try_normalize(1e-9)?, ray];

    let fit = fit_car(atlas, &camera, &reference.plane, keypoints, &ShapePrior::default(), None, &options)?;
    let numbers = 2.0 * keypoints.iter().flatten().count() as f64;
    let worth = StudentT { dimensions: numbers }.weight(2.0 * fit.cost);
    let claimed = axes.map(|axis| (axis.dot(&(turns * axis)).max(0.0) / worth).sqrt());
    let on_plane = fit.car;
    let pose = on_plane.camera_from_car;
    let towards = pose.inverse().translation.vector.xy();
    let angle = towards.y.atan2(towards.x).abs();
    let points = points_off(&camera, &pose, keypoints, box_px, |i| atlas.keypoint_in_car(i, &on_plane.shape));
    Some(SeenCar {
        box_px,
        aspect: Aspect::of(angle),
        along: angle.cos().powi(2),
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
