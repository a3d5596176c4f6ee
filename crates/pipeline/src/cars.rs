//! Cars of a frame on the known plane before the known camera.

use roadplane_base::{
    Camera, CameraEstimate, FrameRecord, GroundPlane, GroundPose, PoseRecord, ShapeAtlas, VehicleClass,
    rows_from_isometry,
};
use roadplane_solve::{CarFit, SceneOptions, ShapePrior, fit_car};

use crate::Config;
use crate::cameras::usable;

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
        let camera =
            Camera { focal_px: estimate.params.focal_px(), principal_point_px: estimate.principal_point_px };
        Self { camera, plane: estimate.params.plane() }
    }
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

/// The line of `poses.jsonl` for a fitted car.
#[must_use]
pub fn pose_record(
    frame: &FrameRecord,
    index: usize,
    fit: &CarFit,
    track: Option<u64>,
    atlas: &ShapeAtlas,
) -> Option<PoseRecord> {
    let record = frame.cars.get(index)?;
    let car = &fit.car;
    let sd = |i: usize| Some(car.ground_covariance[(i, i)].sqrt()).filter(|sd| sd.is_finite());
    let points = record.keypoints.as_deref()?;
    Some(PoseRecord {
        frame: frame.frame,
        time_s: frame.time_s,
        car: index,
        track,
        bbox_px: record.bbox_px,
        score: record.score,
        class: record.class,
        world_from_car: rows_from_isometry(&car.ground.world_from_car()),
        camera_from_car: rows_from_isometry(&car.camera_from_car),
        shape: car.shape.into(),
        dims_m: atlas.dims_m(&car.shape).into(),
        pose_sd: [sd(0), sd(1), sd(2)],
        keypoints_px: points
            .iter()
            .map(|p| p.as_ref().map(|p| [p.pixel.x, p.pixel.y, p.score, p.sd_px()]))
            .collect(),
        reprojection_rms_px: car.reprojection_rms_px,
        used: car.used,
    })
}
