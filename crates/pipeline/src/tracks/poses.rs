//! Converts fits of cars to lines of `poses.jsonl`.

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use roadplane_base::{
    CarRef, FrameRecord, GroundPlane, KEYPOINTS, PoseRecord, Shape, ShapeAtlas, rows_from_isometry,
};
use roadplane_measure::{FrameCamera, POSE_SD_RATIO};
use roadplane_solve::{CarFit, FreeCarFit, SceneOptions};

use crate::stream::cadence::RESET_S;

/// Returns the line of `poses.jsonl` for a fitted car. Its track is filled in later.
#[must_use]
pub fn pose_record(
    frame: &FrameRecord,
    index: usize,
    fit: &CarFit,
    view: &FrameCamera,
    atlas: &ShapeAtlas,
) -> Option<PoseRecord> {
    let car = &fit.car;
    let part = view.part_of_box(&frame.cars.get(index)?.bbox_px);
    let sd = |i: usize| sd_of(car.ground_covariance[(i, i)]);
    let pose = Pose {
        world_from_car: part.world_from_plane * part.from_surface(&car.ground).world_from_car(),
        camera_from_car: car.camera_from_car,
        sd: [sd(0), sd(1), sd(2)],
        shape: car.shape,
        reprojection_rms_px: car.reprojection_rms_px,
        used: car.used,
    };
    record_of(frame, index, &pose, atlas)
}

/// Returns the line of `poses.jsonl` for a car whose pose was fitted with six degrees of freedom.
#[must_use]
pub fn free_pose_record(
    frame: &FrameRecord,
    index: usize,
    fit: &FreeCarFit,
    plane: &GroundPlane,
    options: &SceneOptions,
    atlas: &ShapeAtlas,
) -> Option<PoseRecord> {
    let world_from_camera = plane.camera_from_world().inverse();
    let turn = world_from_camera.rotation.to_rotation_matrix();
    let moved = turn.matrix() * fit.pose_covariance.fixed_view::<3, 3>(3, 3) * turn.matrix().transpose();
    let turned = turn.matrix() * fit.pose_covariance.fixed_view::<3, 3>(0, 0) * turn.matrix().transpose();
    let pose = Pose {
        world_from_car: world_from_camera * fit.camera_from_car,
        camera_from_car: fit.camera_from_car,
        sd: [sd_of(moved[(0, 0)]), sd_of(moved[(1, 1)]), sd_of(turned[(2, 2)])],
        shape: fit.shape,
        reprojection_rms_px: fit.reprojection_rms_px,
        used: fit.inliers.iter().filter(|inlier| **inlier).count() >= options.min_inliers,
    };
    record_of(frame, index, &pose, atlas)
}

/// Returns the sd of a pose's number from its variance under independent errors of the keypoints; `None` if not finite.
fn sd_of(variance: f64) -> Option<f64> {
    Some(variance.sqrt() * POSE_SD_RATIO).filter(|sd| sd.is_finite())
}

/// Poses of inference frames, for the frames over which they are carried.
#[derive(Debug, Default)]
pub struct CarriedPoses {
    /// Poses by the detection that they come from.
    of_looks: BTreeMap<CarRef, PoseRecord>,
    /// Time when old poses were last removed, s.
    pruned_s: f64,
}

impl CarriedPoses {
    /// Stores the pose of a detection. Poses are kept for as long as they may be carried over.
    pub fn store(&mut self, pose: &PoseRecord) {
        if pose.time_s - self.pruned_s > RESET_S {
            self.of_looks.retain(|_, look| pose.time_s - look.time_s <= RESET_S);
            self.pruned_s = pose.time_s;
        }
        let look = PoseRecord { keypoints_px: vec![None; KEYPOINTS], ..pose.clone() };
        self.of_looks.insert(CarRef { frame: pose.frame, car: pose.car }, look);
    }

    /// Returns the line of `poses.jsonl` for a car whose pose is carried over; `None` where its detection gave no pose.
    #[must_use]
    pub fn line(&self, frame: &FrameRecord, car: usize) -> Option<PoseRecord> {
        let record = frame.cars.get(car)?;
        let look = self.of_looks.get(&record.pose_from?)?;
        Some(PoseRecord {
            frame: frame.frame,
            time_s: frame.time_s,
            car,
            bbox_px: record.bbox_px,
            score: record.score,
            pose_from: record.pose_from,
            ..look.clone()
        })
    }
}

/// The numbers that a record needs from either kind of fit.
struct Pose {
    /// Pose of the car in the world, m.
    world_from_car: Isometry3<f64>,
    /// Pose of the car in the camera frame, m.
    camera_from_car: Isometry3<f64>,
    /// Sds of world x (m), world y (m) and heading (rad); `None` where not finite.
    sd: [Option<f64>; 3],
    /// Shape coefficients in the atlas.
    shape: Shape,
    /// Rms distance of the keypoints from their projections, px.
    reprojection_rms_px: f64,
    /// Whether the fit is accepted.
    used: bool,
}

/// Builds the line of `poses.jsonl` for a pose; `None` without keypoints or a finite rms.
fn record_of(frame: &FrameRecord, index: usize, pose: &Pose, atlas: &ShapeAtlas) -> Option<PoseRecord> {
    let record = frame.cars.get(index)?;
    let points = record.keypoints.as_deref()?;
    if !pose.reprojection_rms_px.is_finite() {
        // No keypoint agrees with the pose, so there is no number that a file could contain.
        return None;
    }
    Some(PoseRecord {
        frame: frame.frame,
        time_s: frame.time_s,
        car: index,
        track: None,
        bbox_px: record.bbox_px,
        score: record.score,
        class: record.class,
        world_from_car: rows_from_isometry(&pose.world_from_car),
        camera_from_car: rows_from_isometry(&pose.camera_from_car),
        shape: pose.shape.into(),
        dims_m: atlas.dims_m(&pose.shape).into(),
        pose_sd: pose.sd,
        keypoints_px: points
            .iter()
            .map(|p| p.as_ref().map(|p| [p.pixel.x, p.pixel.y, p.score, p.sd_px()]))
            .collect(),
        reprojection_rms_px: pose.reprojection_rms_px,
        used: pose.used,
        pose_from: None,
    })
}
