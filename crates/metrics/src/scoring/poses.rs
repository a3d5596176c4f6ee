//! Scores the poses of single frames: ADD and viewpoint.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3};
use roadplane_base::{PoseRecord, Shape, ShapeAtlas};

use crate::add::{add_m, diameter_m};
use crate::truth::{Model, Truth, isometry_from_rows};
use crate::viewpoint::rotation_error_rad;

use super::{counts, pairs_by_box};

/// Errors of one car's pose in one frame. The errors are infinite if the car has no estimated pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseScore {
    /// True distance of the car from the camera, m.
    pub distance_m: f64,
    /// ADD of the estimated shape under the estimated pose, in diameters of the true car.
    pub add: f64,
    /// ADD of the true shape under the estimated pose, in diameters of the true car.
    pub add_of_pose: f64,
    /// Angle between the estimated and the true rotation, rad.
    pub rotation_rad: f64,
}

impl PoseScore {
    /// Returns the score of a car without an estimated pose.
    #[must_use]
    pub fn missed(true_camera_from_car: &Isometry3<f64>) -> Self {
        let distance_m = true_camera_from_car.translation.vector.norm();
        Self { distance_m, add: f64::INFINITY, add_of_pose: f64::INFINITY, rotation_rad: f64::INFINITY }
    }
}

/// Returns the errors of an estimated pose and shape. `keypoints_in_car` are the keypoints of the estimated shape, by
/// index (car frame, m).
#[must_use]
pub fn score_pose(
    model: &Model,
    true_camera_from_car: &Isometry3<f64>,
    camera_from_car: &Isometry3<f64>,
    keypoints_in_car: &[Option<Point3<f64>>],
) -> PoseScore {
    let truth = model.keypoints();
    let diameter = diameter_m(&truth);
    let add = |points: &[Option<Point3<f64>>]| {
        add_m(&truth, true_camera_from_car, points, camera_from_car).map_or(f64::INFINITY, |d| d / diameter)
    };
    PoseScore {
        add: add(keypoints_in_car),
        add_of_pose: add(&truth),
        rotation_rad: rotation_error_rad(&true_camera_from_car.rotation, &camera_from_car.rotation),
        ..PoseScore::missed(true_camera_from_car)
    }
}

/// Returns the errors of all true cars that [`counts`] accepts. `poses` are the lines of `poses.jsonl`.
///
/// `analysed` returns whether a frame was processed, given its number and time (s). Poses that the run itself rejected
/// (`used: false`) are left out.
#[must_use]
pub fn score_poses(
    truth: &Truth,
    poses: &[PoseRecord],
    atlas: &ShapeAtlas,
    analysed: impl Fn(u64, f64) -> bool,
) -> Vec<PoseScore> {
    let mut of_frame: BTreeMap<u64, Vec<&PoseRecord>> = BTreeMap::new();
    for pose in poses.iter().filter(|pose| pose.used) {
        of_frame.entry(pose.frame).or_default().push(pose);
    }
    let mut scores = Vec::new();
    for frame in truth.frames.iter().filter(|frame| analysed(frame.frame, frame.time_s)) {
        let poses = of_frame.get(&frame.frame).map_or(&[][..], Vec::as_slice);
        let boxes: Vec<[f64; 4]> = poses.iter().map(|pose| pose.bbox_px).collect();
        let cars: Vec<_> = frame.cars.iter().collect();
        let car_of = pairs_by_box(&boxes, &cars);
        for (c, car) in cars.iter().enumerate() {
            let Some(model) = truth.model(car.id).filter(|model| counts(car, model)) else { continue };
            let true_pose = truth.camera.camera_from_car(car);
            let score = match car_of.iter().position(|of| *of == Some(c)) {
                Some(p) => {
                    let points = atlas.keypoints_in_car(&Shape::from(poses[p].shape));
                    let points = points.map(|point| Some(Point3::from(point)));
                    let pose = isometry_from_rows(&poses[p].camera_from_car);
                    score_pose(model, &true_pose, &pose, &points)
                }
                None => PoseScore::missed(&true_pose),
            };
            scores.push(score);
        }
    }
    scores
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::fixture::lot;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};
    use roadplane_base::{KEYPOINTS, VehicleClass, rows_from_isometry};

    #[test]
    fn shifted_turned_and_missed_cars() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let truth = lot(1);
        let pose = |c: usize, error: Isometry3<f64>| {
            let car = &truth.frames[0].cars[c];
            PoseRecord {
                frame: 0,
                time_s: 0.0,
                car: c,
                track: None,
                bbox_px: car.bbox_px,
                score: 0.9,
                class: VehicleClass::Car,
                world_from_car: car.world_from_car,
                camera_from_car: rows_from_isometry(&(truth.camera.camera_from_car(car) * error)),
                shape: [0.0; 6],
                dims_m: [4.5, 1.8, 1.4],
                pose_sd: [None; 3],
                keypoints_px: vec![None; KEYPOINTS],
                reprojection_rms_px: 1.0,
                used: c != 2,
                pose_from: None,
            }
        };
        let shift = Isometry3::from_parts(Translation3::new(0.5, 0.0, 0.0), UnitQuaternion::identity());
        let turn = Isometry3::from_parts(
            Translation3::identity(),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.2),
        );
        // The poses are in another order than the cars. The run rejected the third pose.
        let poses = [pose(1, turn), pose(0, shift), pose(2, Isometry3::identity())];
        let scores = score_poses(&truth, &poses, &atlas, |_, _| true);
        let diameter = diameter_m(&truth.models[0].keypoints());
        assert!((scores[0].add - 0.5 / diameter).abs() < 1e-6 && scores[0].rotation_rad < 1e-6);
        assert!((scores[0].add_of_pose - scores[0].add).abs() < 1e-9);
        assert!((scores[1].rotation_rad - 0.2).abs() < 1e-6);
        assert!(scores[2].add.is_infinite() && scores[2].rotation_rad.is_infinite());
        assert!(score_poses(&truth, &poses, &atlas, |frame, _| frame > 0).is_empty());
    }
}
