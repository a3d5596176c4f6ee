//! Converts fits of cars to lines of `poses.jsonl`.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::{
    CarRef, FrameRecord, GroundPlane, KEYPOINTS, PictureMotion, PoseRecord, Shape, ShapeAtlas,
    rows_from_isometry,
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
    let world_from_car = part.world_from_plane * part.from_surface(&car.ground).world_from_car();
    Some(PoseRecord {
        world_from_car: rows_from_isometry(&world_from_car),
        camera_from_car: rows_from_isometry(&car.camera_from_car),
        pose_sd: [0, 1, 2].map(|i| sd_of(car.ground_covariance[(i, i)])),
        used: car.used,
        ..record_of(frame, index, &car.shape, car.reprojection_rms_px, atlas)?
    })
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
    Some(PoseRecord {
        world_from_car: rows_from_isometry(&(world_from_camera * fit.camera_from_car)),
        camera_from_car: rows_from_isometry(&fit.camera_from_car),
        pose_sd: [moved[(0, 0)], moved[(1, 1)], turned[(2, 2)]].map(sd_of),
        used: fit.inliers.iter().filter(|inlier| **inlier).count() >= options.min_inliers,
        ..record_of(frame, index, &fit.shape, fit.reprojection_rms_px, atlas)?
    })
}

/// Converts the pixels of a pose from the world picture to the picture of its frame.
pub fn move_to_picture(pose: &mut PoseRecord, picture_from_world: &PictureMotion) {
    pose.bbox_px = picture_from_world.apply_to_box(&pose.bbox_px);
    for [x, y, ..] in pose.keypoints_px.iter_mut().flatten() {
        let at = picture_from_world.apply(&Vector2::new(*x, *y));
        (*x, *y) = (at.x, at.y);
    }
}

/// Returns the sd of a pose's number from its variance under independent errors of the keypoints; `None` if not finite.
fn sd_of(variance: f64) -> Option<f64> {
    Some(variance.sqrt() * POSE_SD_RATIO).filter(|sd| sd.is_finite())
}

/// Poses of inference frames, for the frames over which they are carried.
#[derive(Debug, Default)]
pub struct CarriedPoses {
    /// Poses by the detection that they come from.
    by_source: BTreeMap<CarRef, PoseRecord>,
    /// Time when old poses were last removed, s.
    pruned_s: f64,
}

impl CarriedPoses {
    /// Stores the pose of a detection. Poses are kept for as long as they may be carried over.
    pub fn store(&mut self, pose: &PoseRecord) {
        if pose.time_s - self.pruned_s > RESET_S {
            self.by_source.retain(|_, stored| pose.time_s - stored.time_s <= RESET_S);
            self.pruned_s = pose.time_s;
        }
        let stored = PoseRecord { keypoints_px: vec![None; KEYPOINTS], ..pose.clone() };
        self.by_source.insert(CarRef { frame: pose.frame, car: pose.car }, stored);
    }

    /// Returns the line of `poses.jsonl` for a car whose pose is carried over; `None` where its detection gave no pose.
    #[must_use]
    pub fn line(&self, frame: &FrameRecord, car: usize) -> Option<PoseRecord> {
        let record = frame.cars.get(car)?;
        let earlier = self.by_source.get(&record.pose_from?)?;
        Some(PoseRecord {
            frame: frame.frame,
            time_s: frame.time_s,
            car,
            bbox_px: record.bbox_px,
            score: record.score,
            pose_from: record.pose_from,
            ..earlier.clone()
        })
    }
}

/// Builds the line of `poses.jsonl` for a car, without its pose; `None` without keypoints or a finite rms (px).
fn record_of(
    frame: &FrameRecord,
    index: usize,
    shape: &Shape,
    reprojection_rms_px: f64,
    atlas: &ShapeAtlas,
) -> Option<PoseRecord> {
    let record = frame.cars.get(index)?;
    let points = record.keypoints.as_deref()?;
    if !reprojection_rms_px.is_finite() {
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
        world_from_car: Default::default(),
        camera_from_car: Default::default(),
        shape: (*shape).into(),
        dims_m: atlas.dims_m(shape).into(),
        pose_sd: [None; 3],
        keypoints_px: points
            .iter()
            .map(|p| p.as_ref().map(|p| [p.pixel.x, p.pixel.y, p.score, p.sd_px()]))
            .collect(),
        reprojection_rms_px,
        used: false,
        pose_from: None,
    })
}
