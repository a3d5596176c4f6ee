//! The product's camera beside the known one.

use std::path::Path;

use nalgebra::Vector4;
use roadplane_base::{CameraEstimate, CameraStatus, PoseRecord, angle_difference};
use roadplane_pipeline::{Cancel, Config, Silent, SolveOptions, solve_file};
use roadplane_write::{read_camera, read_jsonl};

use crate::LabError;
use crate::workplace::Workplace;
use roadplane_metrics::readers::cameras::ReferenceCamera;

/// What a run says of a known camera.
pub(super) struct Outcome {
    /// The estimate that holds longest.
    pub estimate: CameraEstimate,
    /// Errors of log focal, tilt (rad), roll (rad), log height.
    pub errors: Vector4<f64>,
    /// The same in sds, that of the truth counted.
    pub in_sds: Vector4<f64>,
    /// Horizon in the middle of the picture, found minus true, px down.
    pub horizon_px: f64,
    /// Cars of the first frame as the estimate has them.
    pub cars: Vec<PoseRecord>,
}

impl Outcome {
    /// Whether the focal length is claimed to be found, to this sd of its logarithm.
    pub fn claims(&self, log_sd: f64) -> bool {
        self.estimate.status == CameraStatus::Estimated && self.estimate.covariance[(0, 0)].sqrt() <= log_sd
    }
}

/// Solves the frames as `run` and `solve` do.
pub(super) fn outcome(
    known: &ReferenceCamera,
    frames: &Path,
    config: &Config,
    cancel: &Cancel,
) -> Result<Outcome, LabError> {
    let place = Workplace::new(None)?;
    let poses = place.folder().join("poses.jsonl");
    let options = SolveOptions::default();
    solve_file(frames, &poses, &options, config, cancel, &Silent)?;
    let mut cars: Vec<PoseRecord> = Vec::new();
    for pose in read_jsonl::<PoseRecord>(&poses)? {
        let pose = pose?;
        if cars.first().is_some_and(|first| first.frame != pose.frame) {
            break;
        }
        cars.push(pose);
    }
    let estimate = read_camera(&poses.with_file_name("camera.json"))?.camera.estimate();
    let truth =
        Vector4::new(known.focal_px.ln(), known.plane.tilt(), known.plane.roll(), known.plane.height_m.ln());
    let mut errors = estimate.params.to_vector() - truth;
    errors[2] = angle_difference(estimate.params.roll, known.plane.roll());
    let in_sds =
        Vector4::from_fn(|i, _| errors[i] / (estimate.covariance[(i, i)] + known.sd[i] * known.sd[i]).sqrt());
    let horizon = |principal: f64, focal_px: f64, tilt: f64| principal - focal_px * tilt.tan();
    let middle = estimate.principal_point_px.y;
    let horizon_px = horizon(middle, estimate.params.focal_px(), estimate.params.tilt)
        - horizon(known.principal_point_px.y, known.focal_px, known.plane.tilt());
    Ok(Outcome { estimate, errors, in_sds, horizon_px, cars })
}
