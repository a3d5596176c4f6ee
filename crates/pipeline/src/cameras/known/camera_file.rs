//! Reads the file of `--camera FILE`: a camera that was calibrated before, or estimated by an earlier run.

use std::path::Path;

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, CameraStatus, ImageSize};
use roadplane_calibrate::{LEAST_SD, Survey};
use roadplane_write::{WriteError, read_camera};
use yaml_rust2::{Yaml, YamlLoader};

use super::measured::{GUESSED_HEIGHT_SHARE, GUESSED_TILT_SD_DEG};
use crate::cameras::joining::POPULATION_LOG_SD;
use crate::cameras::krtd::read_krtd;

/// Variance of a number without an sd in the file (log² or rad²).
const UNKNOWN_VARIANCE: f64 = 1e4;

/// The lens distortion as the user gave it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum GivenLens {
    /// OpenCV's k1 and k2, which are defined only together with a focal length.
    Opencv([f64; 2]),
    /// Distortion at the picture's side, see [`Lens::distortion`](roadplane_base::Lens::distortion) (dimensionless).
    Distortion(f64),
}

/// The contents of a camera file.
pub(super) struct CameraOfFile {
    /// Size of its pictures, if given.
    pub size: Option<ImageSize>,
    /// Principal point (x, y), px, if given.
    pub principal_point_px: Option<[f64; 2]>,
    /// Focal length without an sd, px.
    pub focal_px: Option<f64>,
    /// Lens distortion, if given.
    pub lens: Option<GivenLens>,
    /// The camera's four numbers, as far as the file has them.
    pub survey: Option<Survey>,
}

/// Reads a camera file. The ending gives the format: `.json` (ours), `.krtd` (MEVA), `.yml` or `.yaml` (OpenCV, ROS).
///
/// # Errors
/// [`WriteError::Io`] for a file that cannot be read, [`WriteError::Malformed`] for one that is not of its format.
pub(super) fn read(path: &Path) -> Result<CameraOfFile, WriteError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    match extension.as_str() {
        "json" => ours(path),
        "krtd" => krtd(path),
        "yml" | "yaml" => opencv(path),
        _ => Err(WriteError::malformed(
            path,
            "its name must end in .json (camera.json), .krtd, .yml or .yaml (OpenCV's camera_matrix)",
        )),
    }
}

/// Reads `camera.json` of a run.
///
/// Without a constraint in metres, the uncertainty of its height includes that of the cars' size, which the next run's
/// cars share.
fn ours(path: &Path) -> Result<CameraOfFile, WriteError> {
    let camera = read_camera(path)?.camera;
    if camera.status == CameraStatus::Unobservable {
        return Err(WriteError::malformed(
            path,
            "this camera could not be estimated, so the file has no information",
        ));
    }
    if camera.ground.len() > 1 {
        tracing::warn!(
            "the ground of the camera file is two planes, and the first one is used: {}",
            path.display()
        );
    }
    let estimate = camera.estimate();
    let population = POPULATION_LOG_SD * POPULATION_LOG_SD;
    // The numbers of the file are rounded.
    let by_cars = estimate.covariance[(3, 3)] >= 0.999 * population;
    let mut covariance = estimate.covariance;
    if by_cars {
        covariance[(3, 3)] -= population;
    }
    for i in 0..4 {
        if !covariance[(i, i)].is_finite() {
            covariance.row_mut(i).fill(0.0);
            covariance.column_mut(i).fill(0.0);
            covariance[(i, i)] = UNKNOWN_VARIANCE;
        }
        covariance[(i, i)] = covariance[(i, i)].max(0.0) + LEAST_SD * LEAST_SD;
    }
    let information = covariance
        .cholesky()
        .ok_or_else(|| WriteError::malformed(path, "covariance is not positive definite"))?
        .inverse();
    Ok(CameraOfFile {
        size: Some(camera.image_size_px),
        principal_point_px: Some(camera.principal_point_px),
        focal_px: None,
        // A lens that was only assumed to have no distortion is no constraint.
        lens: estimate
            .distortion_sd
            .map(|_| GivenLens::Distortion(estimate.lens.distortion(estimate.image_size_px))),
        survey: Some(Survey { mean: estimate.params.to_vector(), information, by_cars }),
    })
}

/// Reads a surveyed camera. Its focal length is exact; its plane is about the ground of its world.
fn krtd(path: &Path) -> Result<CameraOfFile, WriteError> {
    let camera = read_krtd(path)?;
    let params = CameraParams::new(camera.focal_px(), &camera.plane);
    let angle = 1.0 / GUESSED_TILT_SD_DEG.to_radians().powi(2);
    let sure = Vector4::new(0.0, angle, angle, GUESSED_HEIGHT_SHARE.powi(-2));
    let (mean, information) = (params.to_vector(), Matrix4::from_diagonal(&sure));
    Ok(CameraOfFile {
        size: None,
        principal_point_px: Some(camera.principal_point_px),
        focal_px: Some(camera.focal_px()),
        lens: lens(&camera.distortion),
        survey: Some(Survey { mean, information, by_cars: false }),
    })
}

/// Reads `camera_matrix` of a calibration by OpenCV or ROS; its focal length is exact.
fn opencv(path: &Path) -> Result<CameraOfFile, WriteError> {
    let text = std::fs::read_to_string(path).map_err(WriteError::io("read", path))?;
    // The first line of OpenCV's files, `%YAML:1.0`, is not valid YAML.
    let body = text.strip_prefix("%YAML:1.0").unwrap_or(&text);
    let documents = YamlLoader::load_from_str(body).map_err(|e| WriteError::malformed(path, e))?;
    let fail = |what: &str| WriteError::malformed(path, what);
    let document = documents.first().ok_or_else(|| fail("is empty"))?;
    let matrix = numbers(&document["camera_matrix"]["data"])
        .or_else(|| numbers(&document["camera_matrix"]))
        .ok_or_else(|| fail("camera_matrix.data must be nine numbers"))?;
    let [fx, _, cx, _, fy, cy, _, _, one] =
        <[f64; 9]>::try_from(matrix).map_err(|_other| fail("camera_matrix.data must be nine numbers"))?;
    if !(fx > 0.0 && fy > 0.0 && (one - 1.0).abs() < 1e-9) {
        return Err(fail("camera_matrix is no matrix of a pinhole camera"));
    }
    let side = |name: &str| u32::try_from(document[name].as_i64()?).ok().filter(|side| *side > 0);
    let size = side("image_width").zip(side("image_height"));
    let distortion = &document["distortion_coefficients"];
    let distortion = numbers(&distortion["data"]).or_else(|| numbers(distortion));
    Ok(CameraOfFile {
        size: size.map(|(width, height)| ImageSize { width, height }),
        principal_point_px: Some([cx, cy]),
        focal_px: Some((fx * fy).sqrt()),
        lens: distortion.and_then(|k| lens(&k)),
        survey: None,
    })
}

/// Returns the finite numbers of a list, including nested lists; `None` for anything else.
fn numbers(yaml: &Yaml) -> Option<Vec<f64>> {
    let mut found = Vec::new();
    for item in yaml.as_vec()? {
        match item.as_f64().or_else(|| item.as_i64().map(|v| v as f64)) {
            Some(number) if number.is_finite() => found.push(number),
            _ => found.extend(numbers(item)?),
        }
    }
    Some(found)
}

/// Returns the radial part of OpenCV's coefficients (k1, k2, p1, p2, k3).
fn lens(coefficients: &[f64]) -> Option<GivenLens> {
    let k1 = *coefficients.first()?;
    Some(GivenLens::Opencv([k1, coefficients.get(1).copied().unwrap_or(0.0)]))
}
