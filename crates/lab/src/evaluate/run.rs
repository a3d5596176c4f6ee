//! Scores a finished run against a truth file, a calibrated camera, vehicles that other sensors tracked, or labelled
//! boxes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use roadplane_base::{GroundPlane, ShapeAtlas};
use roadplane_pipeline::{Krtd, read_krtd};
use roadplane_tables::{Cell, Column, Report, Table};
use roadplane_write::CameraSegment;

use crate::LabError;
use crate::evaluate::vehicles::against_vehicles;
use crate::finished_run::{FinishedRun, pictures};
use crate::tables::{
    add_plot, add_table, boxes_table, calibration_table, classes_table, motion_table, position_plot,
    position_table, tracking_table, viewpoint_plot, viewpoint_table,
};
use roadplane_metrics::average_precision::{PictureBoxes, TrueBox};
use roadplane_metrics::camera::camera_error;
use roadplane_metrics::readers::kpf::{KpfBox, read_boxes, read_types};
use roadplane_metrics::scoring::{score_poses, score_tracks};
use roadplane_metrics::truth::{Truth, read_truth};

/// Names of cars in KPF files (VIRAT and MEVA).
const VEHICLES: [&str; 3] = ["Vehicle", "vehicle", "Car"];
/// Largest relative difference between the picture size of the run and that of the truth.
const SIZE_SLACK: f64 = 0.05;

/// Scores a finished run against truth. The end of the truth file's name decides which kind of truth the file has.
///
/// - `.krtd`: a camera alone.
/// - `.vehicles.json`: vehicles that other sensors tracked, in another world frame.
/// - `geom.yml`: boxes alone (KPF, with `types.yml` beside it).
/// - other names: a truth file (`roadplane.truth/1`).
///
/// # Errors
/// [`LabError`] for files that cannot be read, have another format, or do not belong together.
pub fn evaluate_run(folder: &Path, truth: &Path, atlas: &ShapeAtlas) -> Result<Report, LabError> {
    let run = FinishedRun::read(folder)?;
    let name = folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned();
    let file = truth.to_string_lossy();
    if file.ends_with(".krtd") {
        against_camera(&run, &read_krtd(truth)?, &name)
    } else if file.ends_with(".vehicles.json") {
        against_vehicles(&run, truth, &name)
    } else if let Some(stem) = file.strip_suffix("geom.yml") {
        // `boxes.geom.yml` belongs to `types.yml`, and `CLIP.geom.yml` to `CLIP.types.yml`.
        let own = PathBuf::from(format!("{stem}types.yml"));
        let types = if own.is_file() { own } else { truth.with_file_name("types.yml") };
        against_boxes(&run, &read_boxes(truth)?, &read_types(&types)?, &name)
    } else {
        against_truth(&run, &read_truth(truth)?, atlas, &name)
    }
}

fn against_camera(run: &FinishedRun, truth: &Krtd, name: &str) -> Result<Report, LabError> {
    same_size(&run.camera, truth.principal_point_px.map(|centre| 2.0 * centre + 1.0))?;
    let mut table = camera_table(&run.camera, truth.focal_px(), &truth.plane);
    table.note += &format!(
        " Truth: focal length {:.1} × {:.1} px, ground z = 0, lens distortion {:?}.",
        truth.focal_x_px, truth.focal_y_px, truth.distortion
    );
    Ok(Report { title: format!("Camera of run {name}"), tables: vec![table], ..Report::default() })
}

fn against_truth(
    run: &FinishedRun,
    truth: &Truth,
    atlas: &ShapeAtlas,
    name: &str,
) -> Result<Report, LabError> {
    same_size(&run.camera, <[u32; 2]>::from(truth.camera.image_size_px).map(f64::from))?;
    let frames = run.analysed(truth);
    if frames.is_empty() {
        return Err(LabError::unsuitable("the run processed no frame that has truth"));
    }
    let analysed = |frame: u64, _: f64| frames.contains(&frame);
    let poses = [score_poses(truth, &run.poses, atlas, analysed)];
    let tracks = [score_tracks(truth, &run.rows, analysed)];
    let positions = [tracks[0].positions.clone()];
    let boxes = [pictures(run, truth, &frames)];
    let tables = vec![
        camera_table(&run.camera, truth.camera.focal_px, &truth.camera.plane()),
        tracking_table("Tracks on the ground", &[(name, &tracks)]),
        position_table("Position", &[(name, &positions)]),
        calibration_table("Position against its sd", &[(name, &tracks)]),
        motion_table("Motion", &[(name, &tracks)]),
        add_table("Poses: ADD", &[(name, &poses)]),
        viewpoint_table("Poses: viewpoint", &[(name, &poses)]),
        boxes_table("Boxes of cars that got a pose", &[(name, &boxes)]),
        classes_table(truth, &run.rows),
    ];
    let plots = vec![
        add_plot(&[(name, &poses)]),
        viewpoint_plot(&[(name, &poses)]),
        position_plot(&[(name, &positions)]),
    ];
    Ok(Report { title: format!("Run {name} against truth"), tables, plots, ..Report::default() })
}

fn against_boxes(
    run: &FinishedRun,
    truth: &[KpfBox],
    types: &BTreeMap<u64, String>,
    name: &str,
) -> Result<Report, LabError> {
    let labelled: BTreeMap<u64, f64> = truth.iter().map(|label| (label.frame, label.time_s)).collect();
    let frames = run.processed(labelled.into_iter());
    if frames.is_empty() {
        return Err(LabError::unsuitable("the run processed no labelled frame"));
    }
    let is_vehicle =
        |label: &&KpfBox| types.get(&label.track).is_some_and(|kind| VEHICLES.contains(&kind.as_str()));
    let true_box = |label: &KpfBox| {
        TrueBox::new(label.bbox_px, label.occlusion.as_deref().is_some_and(|share| share != "partially"))
    };
    let picture = |frame: &u64| PictureBoxes {
        truth: truth.iter().filter(|label| label.frame == *frame).filter(is_vehicle).map(true_box).collect(),
        found: run.boxes(*frame),
    };
    let pictures = [frames.iter().map(picture).collect()];
    let mut table = boxes_table("Boxes of cars that got a pose", &[(name, &pictures)]);
    table.note += " Truth: vehicles of the KPF file; those mostly hidden are ignored.";
    Ok(Report { title: format!("Boxes of run {name}"), tables: vec![table], ..Report::default() })
}

fn same_size(camera: &CameraSegment, truth_px: [f64; 2]) -> Result<(), LabError> {
    let run_px = <[u32; 2]>::from(camera.image_size_px).map(f64::from);
    let differ = |i: usize| (run_px[i] / truth_px[i] - 1.0).abs() > SIZE_SLACK;
    if differ(0) || differ(1) {
        let what = format!(
            "the run's pictures have {} × {} px, the truth's about {:.0} × {:.0}",
            run_px[0], run_px[1], truth_px[0], truth_px[1]
        );
        return Err(LabError::unsuitable(what));
    }
    Ok(())
}

/// Returns the table of the camera's focal length, height, tilt and roll: estimate, sd, truth and error.
fn camera_table(camera: &CameraSegment, true_focal_px: f64, true_plane: &GroundPlane) -> Table {
    let error = camera_error(camera.focal_px, &camera.plane(), true_focal_px, true_plane);
    let columns = [
        ("", 0),
        ("estimate", 2),
        ("sd", 2),
        ("truth", 2),
        ("error", 2),
        ("error, %", 2),
        ("normalised error", 2),
    ];
    let note = format!(
        "Estimated from {} cars in {} frames; the angle between the normals is {:.2}°.",
        camera.cars_used,
        camera.frames_used,
        error.normal_rad.to_degrees()
    );
    let mut table = Table::new(
        "Camera",
        note,
        columns.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect(),
    );
    let degrees = 1f64.to_degrees();
    let mut row = |name: &str, estimate: f64, sd: Option<f64>, error: f64, relative: Option<f64>| {
        let sd = sd.unwrap_or(f64::NAN);
        let cells = [estimate, sd, estimate - error, error, 100.0 * relative.unwrap_or(f64::NAN), error / sd];
        table.rows.push(std::iter::once(Cell::from(name)).chain(cells.map(Cell::from)).collect());
    };
    let (focal, height) = (error.focal_relative, error.height_relative);
    row("focal length, px", camera.focal_px, camera.focal_sd_px, focal * true_focal_px, Some(focal));
    row("height, m", camera.height_m, camera.height_sd_m, height * true_plane.height_m, Some(height));
    let angle =
        |rad: f64, sd: Option<f64>, error: f64| (rad * degrees, sd.map(|s| s * degrees), error * degrees);
    let (tilt, sd, off) = angle(camera.tilt_rad, camera.tilt_sd_rad, error.tilt_rad);
    row("tilt, °", tilt, sd, off, None);
    let (roll, sd, off) = angle(camera.roll_rad, camera.roll_sd_rad, error.roll_rad);
    row("roll, °", roll, sd, off, None);
    table
}
