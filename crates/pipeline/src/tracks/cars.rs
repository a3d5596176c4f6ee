//! Cars of a frame on the known plane before the known camera.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, SMatrix};
use roadplane_base::{
    Camera, CameraEstimate, CarRef, FrameRecord, GroundPlane, GroundPose, KEYPOINTS, MODES, PoseRecord,
    Shape, ShapeAtlas, VehicleClass, rows_from_isometry,
};
use roadplane_solve::{CarFit, FreeCarFit, SceneOptions, ShapePrior, fit_car};

use crate::Config;
use crate::stream::cadence::FORGET_S;
use crate::tracks::believe::usable;

/// A frame's camera, ready to use.
#[derive(Clone, Copy, Debug)]
pub struct FrameCamera {
    /// Pinhole.
    pub camera: Camera,
    /// Ground.
    pub plane: GroundPlane,
}

impl From<&CameraEstimate> for FrameCamera {
    fn from(estimate: &CameraEstimate) -> Self {
        let camera = estimate.camera();
        Self { camera, plane: estimate.params.plane() }
    }
}

/// What is known of the shape of any car of a place whose cars are larger than the atlas' by this, log.
#[must_use]
pub fn any_car(atlas: &ShapeAtlas, size_of_cars: f64) -> ShapePrior {
    // The coefficients that come nearest to the mean car made larger, least squares over its keypoints.
    let mut normal = SMatrix::<f64, MODES, MODES>::zeros();
    let mut right = Shape::zeros();
    for (i, mean) in atlas.mean.iter().enumerate() {
        let modes = SMatrix::<f64, 3, MODES>::from_fn(|axis, mode| atlas.modes[mode][i][axis]);
        normal += modes.transpose() * modes;
        right += modes.transpose() * mean * size_of_cars.exp_m1();
    }
    let mean = normal.cholesky().map_or_else(Shape::zeros, |normal| normal.solve(&right));
    ShapePrior { mean: atlas.clamped(&mean), ..ShapePrior::default() }
}

/// Fits every car of the frame that has keypoints; `known(i)` gives what is known of car i beforehand: its shape and
/// about where it is.
pub fn fit_frame(
    frame: &FrameRecord,
    view: &FrameCamera,
    atlas: &ShapeAtlas,
    options: &SceneOptions,
    config: &Config,
    known: impl Fn(usize) -> (ShapePrior, Option<GroundPose>),
) -> Vec<Option<CarFit>> {
    let fit = |(i, car): (usize, &roadplane_base::CarRecord)| {
        if car.class != VehicleClass::Car {
            return None;
        }
        let keypoints = usable(car.keypoints.as_deref()?, config);
        let (shape, start) = known(i);
        fit_car(atlas, &view.camera, &view.plane, &keypoints, &shape, start.as_ref(), options)
    };
    frame.cars.iter().enumerate().map(fit).collect()
}

/// The line of `poses.jsonl` for a fitted car, not yet told its track.
#[must_use]
pub fn pose_record(
    frame: &FrameRecord,
    index: usize,
    fit: &CarFit,
    atlas: &ShapeAtlas,
) -> Option<PoseRecord> {
    let car = &fit.car;
    let sd = |i: usize| Some(car.ground_covariance[(i, i)].sqrt()).filter(|sd| sd.is_finite());
    let pose = Pose {
        world_from_car: car.ground.world_from_car(),
        camera_from_car: car.camera_from_car,
        sd: [sd(0), sd(1), sd(2)],
        shape: car.shape,
        reprojection_rms_px: car.reprojection_rms_px,
        used: car.used,
    };
    record_of(frame, index, &pose, atlas)
}

/// The line of `poses.jsonl` for a car that was left free in six degrees of freedom.
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
    let sd = |variance: f64| Some(variance.sqrt()).filter(|sd| sd.is_finite());
    let pose = Pose {
        world_from_car: world_from_camera * fit.camera_from_car,
        camera_from_car: fit.camera_from_car,
        sd: [sd(moved[(0, 0)]), sd(moved[(1, 1)]), sd(turned[(2, 2)])],
        shape: fit.shape,
        reprojection_rms_px: fit.reprojection_rms_px,
        used: fit.inliers.iter().filter(|inlier| **inlier).count() >= options.min_inliers,
    };
    record_of(frame, index, &pose, atlas)
}

/// Poses of looks, for the frames in which they are held.
#[derive(Debug, Default)]
pub struct HeldPoses {
    of_looks: BTreeMap<CarRef, PoseRecord>,
    pruned_s: f64,
}

impl HeldPoses {
    /// Remembers a look's pose; memory reaches back as far as poses are held.
    pub fn remember(&mut self, pose: &PoseRecord) {
        if pose.time_s - self.pruned_s > FORGET_S {
            self.of_looks.retain(|_, look| pose.time_s - look.time_s <= FORGET_S);
            self.pruned_s = pose.time_s;
        }
        let look = PoseRecord { keypoints_px: vec![None; KEYPOINTS], ..pose.clone() };
        self.of_looks.insert(CarRef { frame: pose.frame, car: pose.car }, look);
    }

    /// The line of `poses.jsonl` for a car whose pose is held; `None` where its look came to nothing.
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

/// What a record takes from either kind of fit.
struct Pose {
    world_from_car: Isometry3<f64>,
    camera_from_car: Isometry3<f64>,
    /// Of world x, y and heading.
    sd: [Option<f64>; 3],
    shape: Shape,
    reprojection_rms_px: f64,
    used: bool,
}

fn record_of(frame: &FrameRecord, index: usize, pose: &Pose, atlas: &ShapeAtlas) -> Option<PoseRecord> {
    let record = frame.cars.get(index)?;
    let points = record.keypoints.as_deref()?;
    if !pose.reprojection_rms_px.is_finite() {
        // Not one keypoint agrees: no pose, and no number that a file could hold.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cars_of_a_place_are_as_large_as_it_says() {
        let atlas = ShapeAtlas::shipped().unwrap();
        assert_eq!(any_car(&atlas, 0.0), ShapePrior::default());
        for log_size in [-0.05, 0.02, 0.05] {
            let dims_m = atlas.dims_m(&any_car(&atlas, log_size).mean);
            // The modes of cars make width grow less than length and height.
            let larger = dims_m.component_div(&atlas.dims_mean).map(f64::ln) / log_size;
            assert!((larger.mean() - 1.0).abs() < 0.2 && larger.min() > 0.5, "{log_size}: {larger}");
        }
    }
}
