//! Scores activities on a table of labelled tracks, where each track is one instance of one activity.
//!
//! `roadplane-train activity meva` makes such a table from the data set MEVA.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_activity::{Label, Motion, Probabilities};
use roadplane_pipeline::{Cancel, PipelineError, Progress};
use roadplane_tables::Report;
use roadplane_write::{TableRow, read_table};
use serde_json::Value;

use super::rows::{Row, Seen, picture_motion};
use super::scores::{Case, differences, each_label, table};
use crate::LabError;
use crate::work::stopped;

/// Height of the pictures in which MEVA's boxes are given, px.
const PICTURE_HEIGHT_PX: f64 = 1080.0;

/// Predicts the label of each instance in a table file and returns the tables of scores.
pub fn evaluate(
    path: &Path,
    systems: &mut [Row],
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let rows = read_table(path)?;
    let mut instances: BTreeMap<u64, Vec<(usize, &TableRow)>> = BTreeMap::new();
    for (index, row) in rows.iter().enumerate() {
        let track = row.get("track").and_then(Value::as_u64);
        let track = track.ok_or_else(|| bad(path, index, "track is missing or no whole number"))?;
        instances.entry(track).or_default().push((index, row));
    }
    progress.expect(Some(instances.len() as u64));
    let mut clips: BTreeMap<String, Vec<Case>> = BTreeMap::new();
    let mut labels: Vec<Label> = instances.values().filter_map(|rows| label_of(rows[0].1)).collect();
    labels.sort();
    labels.dedup();
    for rows in instances.values() {
        stopped(cancel)?;
        let (index, first) = rows[0];
        let label =
            label_of(first).ok_or_else(|| bad(path, index, "label is missing or none of roadplane's"))?;
        let mut predicted = Vec::new();
        for system in systems.iter_mut() {
            let motion = motion(rows, path, system.seen)?;
            predicted.push(most_probable(
                &system.net.probabilities(&motion).map_err(PipelineError::from)?,
                &labels,
            ));
        }
        let clip = first.get("clip").and_then(Value::as_str).unwrap_or_default();
        clips.entry(clip.to_owned()).or_default().push(Case { truth: vec![label], predicted });
        progress.frame_done();
    }
    let clips: Vec<Vec<Case>> = clips.into_values().collect();
    let systems: Vec<&str> = systems.iter().map(|system| system.name).collect();
    let count: usize = clips.iter().map(Vec::len).sum();
    let mut report = Report { title: format!("Activities, {count} instances"), ..Report::default() };
    report.tables.push(table("Instances", "", &clips, &systems, &labels));
    report.tables.push(differences("3D against the others", &clips, &systems, systems.len() - 1, &labels));
    for (system, name) in systems.iter().enumerate() {
        report.tables.push(each_label(&format!("Label by label: {name}"), &clips, system));
    }
    Ok(report)
}

fn bad(path: &Path, index: usize, what: &str) -> LabError {
    LabError::malformed(path, format!("row {}: {what}", index + 1))
}

fn label_of(row: &TableRow) -> Option<Label> {
    row.get("label").and_then(Value::as_str).and_then(Label::named)
}

/// Returns the label of a whole instance: the one of `labels` with the greatest sum of log probabilities over time.
fn most_probable(found: &Probabilities, labels: &[Label]) -> Label {
    let score = |label: &Label| found.p.iter().map(|p| p[label.index()].max(1e-9).ln()).sum::<f64>();
    labels.iter().copied().max_by(|a, b| score(a).total_cmp(&score(b))).unwrap_or(Label::Moving)
}

/// Returns the motion of an instance. `seen` selects the kind of motion: on the ground or in the picture.
fn motion(rows: &[(usize, &TableRow)], path: &Path, seen: Seen) -> Result<Motion, LabError> {
    let number = |(index, row): &(usize, &TableRow), name: &str| {
        let number = row.get(name).and_then(Value::as_f64);
        number.ok_or_else(|| bad(path, *index, &format!("{name} is missing or no number")))
    };
    let time_s = rows.iter().map(|row| number(row, "time_s")).collect::<Result<Vec<f64>, _>>()?;
    let pairs = |x, y| {
        rows.iter().map(|row| Ok([number(row, x)?, number(row, y)?])).collect::<Result<Vec<_>, LabError>>()
    };
    if seen == Seen::Ground {
        let (xy_m, sd_m) = (pairs("x_m", "y_m")?, pairs("x_sd_m", "y_sd_m")?);
        return Ok(Motion { time_s, xy_m, sd_m, ..Motion::default() });
    }
    let corners = (pairs("bbox_x0_px", "bbox_y0_px")?, pairs("bbox_x1_px", "bbox_y1_px")?);
    let boxes: Vec<[f64; 4]> =
        corners.0.iter().zip(corners.1).map(|([x0, y0], [x1, y1])| [*x0, *y0, x1, y1]).collect();
    Ok(picture_motion(&time_s, &boxes, PICTURE_HEIGHT_PX, seen))
}
