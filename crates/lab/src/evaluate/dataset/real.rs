//! Scores the estimated cameras of real stills against calibrated cameras: focal length, tilt, roll and height.

use std::path::{Path, PathBuf};

use roadplane_base::CameraStatus;
use roadplane_pipeline::{Cancel, Config, Progress, Silent, read_krtd};
use roadplane_tables::{Cell, Column, Table};
use roadplane_write::CameraSegment;

use super::clips::run;
use super::items::DatasetOptions;
use crate::LabError;
use crate::work::stopped;
use crate::workplace::Workplace;
use roadplane_metrics::camera::{CameraError, camera_error};

/// A real still with its estimated camera and the errors of this camera.
pub(super) struct RealStill {
    name: String,
    camera: CameraSegment,
    true_focal_px: f64,
    error: CameraError,
    /// First coefficient of the lens's true radial distortion (k1 of OpenCV).
    distortion: f64,
}

/// Returns the paths of the stills in a folder, each with the path of its camera file (.krtd), sorted by name.
///
/// Stills without a camera file are left out.
///
/// # Errors
/// [`MetricsError::Unreadable`](roadplane_metrics::MetricsError) if the folder cannot be read.
pub(super) fn list(folder: &Path) -> Result<Vec<[PathBuf; 2]>, LabError> {
    let unreadable = |source| roadplane_metrics::MetricsError::unreadable(folder, source);
    let mut pairs = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let camera = entry.map_err(unreadable)?.path();
        if camera.extension().is_none_or(|extension| extension != "krtd") {
            continue;
        }
        let pictures = ["png", "jpg"].map(|extension| camera.with_extension(extension));
        pairs.extend(pictures.into_iter().find(|picture| picture.is_file()).map(|picture| [picture, camera]));
    }
    pairs.sort();
    Ok(pairs)
}

/// Runs the pipeline on every still and compares the estimated camera with the calibrated camera.
pub(super) fn evaluate(
    pairs: &[[PathBuf; 2]],
    workplace: &Workplace,
    options: &DatasetOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Vec<RealStill>, LabError> {
    let mut stills = Vec::new();
    for [picture, camera] in pairs {
        stopped(cancel)?;
        let truth = read_krtd(camera)?;
        let run = run(picture, workplace, options, config, cancel, &Silent)?;
        let error = camera_error(run.camera.focal_px, &run.camera.plane(), truth.focal_px(), &truth.plane);
        let name = picture.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let distortion = truth.distortion.first().copied().unwrap_or(0.0);
        stills.push(RealStill {
            name,
            camera: run.camera,
            true_focal_px: truth.focal_px(),
            error,
            distortion,
        });
        progress.frame_done();
    }
    Ok(stills)
}

/// Returns the table of camera errors, with one row per still.
pub(super) fn table(stills: &[RealStill]) -> Table {
    let columns = [
        ("still", 0),
        ("cars", 0),
        ("focal, px", 0),
        ("sd, px", 0),
        ("truth, px", 0),
        ("error, %", 1),
        ("tilt error, °", 2),
        ("roll error, °", 2),
        ("height, m", 2),
        ("error, %", 1),
        ("k1", 2),
        ("ours", 2),
        ("status", 0),
    ];
    let columns = columns.map(|(title, decimals)| Column::new(title, decimals)).to_vec();
    let note = "Real pictures, one each, from the pixels alone (our boxes, our keypoints). Truth: the camera's \
        calibration, whose z = 0 is roughly the ground. k1: true distortion of the lens; ours: the estimate, empty \
        if the lens was taken for straight.";
    let mut table = Table::new("Real stills: camera", note, columns);
    for still in stills {
        let (camera, error) = (&still.camera, &still.error);
        let status = match camera.status {
            CameraStatus::Estimated => "estimated",
            CameraStatus::FocalGiven => "focal given",
            CameraStatus::FocalFromPrior => "focal from prior",
            CameraStatus::Unobservable => "unobservable",
        };
        table.rows.push(vec![
            Cell::from(format!("{} (real)", still.name)),
            camera.cars_used.to_string().into(),
            camera.focal_px.into(),
            camera.focal_sd_px.unwrap_or(f64::NAN).into(),
            still.true_focal_px.into(),
            (100.0 * error.focal_relative).into(),
            error.tilt_rad.to_degrees().into(),
            error.roll_rad.to_degrees().into(),
            camera.height_m.into(),
            (100.0 * error.height_relative).into(),
            still.distortion.into(),
            camera.lens.as_ref().map_or(f64::NAN, |lens| lens.k1).into(),
            status.into(),
        ]);
    }
    table
}
