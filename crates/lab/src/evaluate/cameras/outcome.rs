//! Compares the estimated camera with the reference camera.

use std::path::Path;

use nalgebra::Vector4;
use roadplane_base::{CameraEstimate, CameraStatus, PoseRecord, angle_difference};
use roadplane_pipeline::{Cancel, Config, Silent, SolveOptions, solve_file};
use roadplane_write::{read_camera, read_jsonl};

use crate::LabError;
use crate::workplace::Workplace;
use roadplane_metrics::readers::cameras::ReferenceCamera;

/// The camera that is estimated from the picture or clip of a reference camera, with its errors.
pub(super) struct Outcome {
    /// The estimated camera of the longest time segment.
    pub estimate: CameraEstimate,
    /// Errors (estimate minus truth) of log focal length, tilt (rad), roll (rad) and log height.
    pub errors: Vector4<f64>,
    /// The same four errors divided by their sds. An sd combines the reported sd and the sd of the truth.
    pub in_sds: Vector4<f64>,
    /// Error of the horizon at the middle column of the picture: estimated minus true row, px (positive downwards).
    pub horizon_px: f64,
    /// Estimated poses of the cars in the first frame that has poses.
    pub cars: Vec<PoseRecord>,
}

impl Outcome {
    /// Returns whether the focal length was estimated and the reported sd of its logarithm is at most `log_sd`.
    pub fn claims(&self, log_sd: f64) -> bool {
        self.estimate.status == CameraStatus::Estimated && self.estimate.covariance[(0, 0)].sqrt() <= log_sd
    }
}

/// Solves the file `frames` as `roadplane run` does, and compares the estimated camera with the reference camera.
pub(super) fn outcome(
    reference: &ReferenceCamera,
    frames: &Path,
    config: &Config,
    cancel: &Cancel,
) -> Result<Outcome, LabError> {
    let workplace = Workplace::new(None)?;
    let poses = workplace.folder().join("poses.jsonl");
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
    let truth = Vector4::new(
        reference.focal_px.ln(),
        reference.plane.tilt(),
        reference.plane.roll(),
        reference.plane.height_m.ln(),
    );
    let mut errors = estimate.params.to_vector() - truth;
    errors[2] = angle_difference(estimate.params.roll, reference.plane.roll());
    let in_sds = Vector4::from_fn(|i, _| {
        errors[i] / (estimate.covariance[(i, i)] + reference.sd[i] * reference.sd[i]).sqrt()
    });
    let horizon = |principal: f64, focal_px: f64, tilt: f64| principal - focal_px * tilt.tan();
    let middle = estimate.principal_point_px.y;
    let horizon_px = horizon(middle, estimate.params.focal_px(), estimate.params.tilt)
        - horizon(reference.principal_point_px.y, reference.focal_px, reference.plane.tilt());
    Ok(Outcome { estimate, errors, in_sds, horizon_px, cars })
}
