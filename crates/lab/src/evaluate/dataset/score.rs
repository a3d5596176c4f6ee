//! Scores the answers of a system for an item of a data set.

use nalgebra::{Point3, Vector2};
use roadplane_base::{Camera, ShapeAtlas};
use roadplane_pipeline::Config;

use super::evidence::{FrameEvidence, SceneEvidence};
use crate::systems::{CarAnswer, FrameAnswer, FrameInput, System};
use roadplane_metrics::camera::CameraError;
use roadplane_metrics::position::{PositionError, position_errors};
use roadplane_metrics::reprojection::reprojection_rms_px;
use roadplane_metrics::scoring::{PoseScore, score_pose};
use roadplane_metrics::truth::{TrueCar, Truth};

/// Errors of a system on one item.
#[derive(Clone, Debug, Default)]
pub(super) struct SystemScore {
    /// Errors of every scored car. Cars that are too small or too hidden are not scored.
    pub cars: Vec<CarScore>,
    /// Errors of the estimated camera of every frame; empty if the system does not estimate the ground.
    pub cameras: Vec<PictureScore>,
}

/// Errors of a car; infinite if the system found no pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct CarScore {
    pub pose: PoseScore,
    pub position: PositionError,
    /// Root mean square distance between projected and true keypoints, as a share of the longer side of the car's box.
    pub reprojection: f64,
    /// Longer side of the box around the car's visible part, px.
    pub side_px: f64,
    /// Visible share of the car, 0–1.
    pub visible_share: f64,
}

/// Errors of the camera that a system estimates for a picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct PictureScore {
    /// Number of scored cars in the picture.
    pub cars: usize,
    pub error: CameraError,
}

/// Runs a system on the sampled frames of an item and scores the answers.
pub(super) fn score(
    system: System,
    truth: &Truth,
    scene: &SceneEvidence,
    sampled: &[usize],
    atlas: &ShapeAtlas,
    config: &Config,
) -> SystemScore {
    let mut score = SystemScore::default();
    for frame in sampled.iter().map(|index| &scene.frames[*index]) {
        let keypoints = frame.usable(config);
        let (size, focal_px) = (truth.camera.image_size_px, truth.camera.focal_px);
        let input = FrameInput { size, focal_px, plane: truth.camera.plane(), cars: &keypoints };
        let answer = system.solve(atlas, &input, config);
        if system.finds_ground() {
            let error =
                answer.camera.map_or(NO_CAMERA, |camera| camera.error(focal_px, &truth.camera.plane()));
            score.cameras.push(PictureScore { cars: frame.cars.len(), error });
        }
        score.cars.extend(cars(truth, frame, &answer, atlas));
    }
    score
}

/// Errors of a picture for which no camera was found.
const NO_CAMERA: CameraError = CameraError {
    focal_relative: f64::INFINITY,
    tilt_rad: f64::INFINITY,
    roll_rad: f64::INFINITY,
    normal_rad: f64::INFINITY,
    height_relative: f64::INFINITY,
    in_sds: [f64::NAN; 3],
};

fn cars(truth: &Truth, frame: &FrameEvidence, answer: &FrameAnswer, atlas: &ShapeAtlas) -> Vec<CarScore> {
    let size = truth.camera.image_size_px;
    // Systems that do not estimate the ground get the true ground here. Their cars need positions on the ground.
    let (focal_px, plane) = answer
        .camera
        .map_or((truth.camera.focal_px, truth.camera.plane()), |camera| (camera.focal_px, camera.plane));
    let camera = Camera::centred(focal_px, size);
    let world_from_camera = plane.camera_from_world().inverse();
    let true_cars = || frame.cars.iter().map(|c| &truth.frames[frame.index].cars[*c]);
    let positions: Vec<_> = true_cars()
        .zip(&answer.cars)
        .map(|(car, answer)| {
            let pose = answer.as_ref().map(|answer| world_from_camera * answer.camera_from_car);
            (pose.map(|pose| pose.translation.vector.xy()), car.world_from_car().translation.vector.xy())
        })
        .collect();
    let score = |((car, answer), position): ((&TrueCar, &Option<CarAnswer>), PositionError)| {
        score_car(truth, car, answer.as_ref(), &camera, position, atlas)
    };
    let errors = position_errors(&positions, positions.len());
    true_cars().zip(&answer.cars).zip(errors).filter_map(score).collect()
}

fn score_car(
    truth: &Truth,
    car: &TrueCar,
    answer: Option<&CarAnswer>,
    camera: &Camera,
    position: PositionError,
    atlas: &ShapeAtlas,
) -> Option<CarScore> {
    let model = truth.model(car.id)?;
    let true_pose = truth.camera.camera_from_car(car);
    let [x0, y0, x1, y1] = car.bbox_px;
    let side_px = (x1 - x0).max(y1 - y0);
    let mut score = CarScore {
        pose: PoseScore::missed(&true_pose),
        position,
        reprojection: f64::INFINITY,
        side_px,
        visible_share: car.visible_share,
    };
    let Some(CarAnswer { camera_from_car, shape }) = answer else { return Some(score) };
    let points = atlas.keypoints_in_car(shape).map(|point| Some(Point3::from(point)));
    score.pose = score_pose(model, &true_pose, camera_from_car, &points);
    let pixels: Vec<Option<Vector2<f64>>> =
        car.keypoints_px.iter().map(|point| point.map(|[x, y, _]| Vector2::new(x, y))).collect();
    if let Some(rms_px) = reprojection_rms_px(camera, camera_from_car, &points, &pixels) {
        score.reprojection = rms_px / side_px;
    }
    Some(score)
}
