//! Scores runs on rendered clips with a turning camera against truth.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector2;
use roadplane_base::{Homography, Turn};
use roadplane_metrics::hota::HotaCounts;
use roadplane_metrics::scoring::score_tracks;
use roadplane_metrics::truth::{TrueCamera, Truth, read_dataset, read_truth};
use roadplane_tables::{Cell, Column, Table, quantile};
use roadplane_write::CameraFile;

use super::Runner;
use super::registrations::Registrations;
use crate::LabError;

/// Runs all clips of a folder, and returns the tables of their errors.
pub(super) fn against_truth(folder: &Path, runner: &Runner<'_>) -> Result<Vec<Table>, LabError> {
    let columns = [
        ("clip", 0),
        ("rotation, median, °", 3),
        ("rotation, 95 %, °", 3),
        ("growth, median, %", 3),
        ("growth, 95 %, %", 3),
        ("HOTA, %", 1),
        ("HOTA fitted, %", 1),
        ("to rest", 1),
        ("focal, true, px", 0),
        ("focal, px", 0),
        ("normalised error", 2),
        ("turns: focal, px", 0),
        ("turns: error, %", 2),
        ("turns: normalised error", 2),
        ("frames not followed, %", 0),
        ("exit code", 0),
    ];
    let note = "Rendered clips whose camera turns or zooms. Rotation and growth: error of the motion since the first \
                frame, over all frames in which it was measured. To rest: HOTA fitted, less that of the clip at rest \
                of the same scene. Turns: the focal length from the motion alone. A camera that is carried along \
                cannot be followed, which the exit code 3 says.";
    let mut table = Table::new(
        format!("Turning cameras against truth: {}", folder.display()),
        note,
        columns.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect(),
    );
    let mut at_rest: BTreeMap<String, f64> = BTreeMap::new();
    let (mut focal_errors, mut turn_errors) = (Vec::new(), Vec::new());
    let mut registrations = Registrations::default();
    let mut items = read_dataset(folder)?.items;
    // The clips at rest come first.
    items.sort_by_key(|path| !is_at_rest(path));
    for path in items {
        let truth = read_truth(&path)?;
        let media = truth.media.as_ref().ok_or_else(|| LabError::malformed(&path, "media: is null"))?;
        let run = runner.run(media, None, true)?;
        let name = media.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        registrations.add(&run.frames, &truth)?;
        let frames = run.finished.analysed(&truth);
        let tracks = score_tracks(&truth, &run.finished.rows, |frame, _| frames.contains(&frame));
        let hota = 100.0 * HotaCounts::of(&tracks.sequence).score().hota;
        let fitted = 100.0 * HotaCounts::of(&tracks.fitted).score().hota;
        let scene = name.rsplit('_').next().unwrap_or_default().to_owned();
        if is_at_rest(&path) {
            at_rest.insert(scene.clone(), fitted);
        }
        let (rotations, growths) = motion_errors(&run.camera, &truth);
        let [turns_px, turns_sd_px] = run.turn_focal_px();
        let focal = &run.finished.camera;
        let true_px = truth.camera.focal_px;
        let focal_error = (focal.focal_px - true_px) / focal.focal_sd_px.unwrap_or(f64::NAN);
        let turn_error = (turns_px - true_px) / turns_sd_px;
        focal_errors.push(focal_error);
        turn_errors.push(turn_error);
        let numbers = [
            quantile(&rotations, 0.5),
            quantile(&rotations, 0.95),
            quantile(&growths, 0.5),
            quantile(&growths, 0.95),
            hota,
            fitted,
            fitted - at_rest.get(&scene).copied().unwrap_or(f64::NAN),
            true_px,
            focal.focal_px,
            focal_error,
            turns_px,
            100.0 * (turns_px / true_px - 1.0),
            turn_error,
            100.0 * run.summary.counts.frames_not_followed as f64 / truth.frames.len() as f64,
            f64::from(run.summary.exit_code),
        ];
        table.rows.push(std::iter::once(Cell::from(name)).chain(numbers.map(Cell::from)).collect());
    }
    Ok(vec![table, calibration_table(&focal_errors, &turn_errors), registrations.table()])
}

fn is_at_rest(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("rest_"))
}

/// Returns the errors of the motion since the first frame: rotations in degrees, growths in per cent.
fn motion_errors(camera: &CameraFile, truth: &Truth) -> (Vec<f64>, Vec<f64>) {
    let found: BTreeMap<u64, Homography> =
        camera.motion.iter().filter_map(|row| Some((row.frame, row.homography()?))).collect();
    let first = found.get(&0).copied().unwrap_or(Homography::IDENTITY);
    let [mut rotations, mut growths] = [Vec::new(), Vec::new()];
    for frame in &truth.frames {
        let Some(exact) = frame.picture_from_world.and_then(Homography::from_numbers) else { continue };
        // Frames that are not displaced have no entry.
        let estimate = found.get(&frame.frame).copied().unwrap_or(Homography::IDENTITY);
        let Some(error) = error_of(&exact, &first.inverse().then(&estimate), &truth.camera) else { continue };
        rotations.push(error.rotation.angle().to_degrees());
        growths.push(100.0 * (error.growth - 1.0).abs());
    }
    (rotations, growths)
}

/// Returns the turn and zoom between the exact and the estimated motion `K₁ R K₀⁻¹`. K₀ is the camera's.
fn error_of(exact: &Homography, estimate: &Homography, camera: &TrueCamera) -> Option<Turn> {
    let centre = Vector2::from(camera.principal_point_px);
    let focal_px = camera.focal_px * exact.turn(camera.focal_px, &centre)?.growth;
    exact.inverse().then(estimate).turn(focal_px, &centre)
}

/// Returns the table of errors in sds over all clips.
fn calibration_table(focal: &[f64], turns: &[f64]) -> Table {
    let columns = [("focal length", 0), ("clips", 0), ("rms normalised error", 2), ("low", 2), ("high", 2)];
    let note = "Low and high: 95 % interval of the rms if all sds are right (normal approximation of the χ distribution).";
    let mut table = Table::new(
        "Errors against their sds",
        note,
        columns.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect(),
    );
    for (name, errors) in [("all evidence", focal), ("turns alone", turns)] {
        let known: Vec<f64> = errors.iter().copied().filter(|error| error.is_finite()).collect();
        let count = known.len() as f64;
        let rms = (known.iter().map(|error| error * error).sum::<f64>() / count).sqrt();
        // The rms of n standard normal errors has the mean √(1 − 1/2n) and the sd 1/√2n, nearly.
        let (middle, half) = ((1.0 - 0.5 / count).sqrt(), 1.96 / (2.0 * count).sqrt());
        let numbers = [count, rms, (middle - half).max(0.0), middle + half];
        table.rows.push(std::iter::once(Cell::from(name)).chain(numbers.map(Cell::from)).collect());
    }
    table
}
