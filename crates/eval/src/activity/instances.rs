//! Labelled tracks, each one instance of one activity, as MEVA's (`python -m activity.meva` makes the table).

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_activity::{ActivityNet, Label, Motion, Probabilities};
use roadplane_pipeline::{Cancel, PipelineError, Progress};
use roadplane_write::{TableRow, read_table};
use serde_json::Value;

use super::scores::{Case, differences, each_label, table};
use super::{ROWS, picture_motion};
use crate::{EvalError, Report};

/// Height of the pictures of MEVA's boxes, px.
const PICTURE_HEIGHT_PX: f64 = 1080.0;

/// The tables.
pub fn evaluate(
    path: &Path,
    nets: &mut [ActivityNet],
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, EvalError> {
    let rows = read_table(path)?;
    let mut instances: BTreeMap<u64, Vec<(usize, &TableRow)>> = BTreeMap::new();
    for (place, row) in rows.iter().enumerate() {
        let track = row.get("track").and_then(Value::as_u64);
        let track = track.ok_or_else(|| bad(path, place, "track is missing or no whole number"))?;
        instances.entry(track).or_default().push((place, row));
    }
    progress.expect(Some(instances.len() as u64));
    let mut clips: BTreeMap<String, Vec<Case>> = BTreeMap::new();
    let mut labels: Vec<Label> = instances.values().filter_map(|rows| label_of(rows[0].1)).collect();
    labels.sort();
    labels.dedup();
    for rows in instances.values() {
        if let Some(signal) = cancel.signal() {
            return Err(PipelineError::Stopped { signal }.into());
        }
        let (place, first) = rows[0];
        let label =
            label_of(first).ok_or_else(|| bad(path, place, "label is missing or none of roadplane's"))?;
        let mut told = Vec::new();
        for (net, motion) in nets.iter_mut().zip(&motions(rows, path)?) {
            told.push(most_probable(&net.probabilities(motion).map_err(PipelineError::from)?, &labels));
        }
        let clip = first.get("clip").and_then(Value::as_str).unwrap_or_default();
        clips.entry(clip.to_owned()).or_default().push(Case { truth: vec![label], told });
        progress.frame_done();
    }
    let clips: Vec<Vec<Case>> = clips.into_values().collect();
    let systems = ROWS.map(|(_, name)| name);
    let count: usize = clips.iter().map(Vec::len).sum();
    let mut report = Report { title: format!("Activities, {count} instances"), ..Report::default() };
    report.tables.push(table("Instances", "", &clips, &systems, &labels));
    report.tables.push(differences("3D against the others", &clips, &systems, 2, &labels));
    for (system, name) in systems.iter().enumerate() {
        report.tables.push(each_label(&format!("Label by label: {name}"), &clips, system));
    }
    Ok(report)
}

fn bad(path: &Path, place: usize, what: &str) -> EvalError {
    EvalError::malformed(path, format!("row {}: {what}", place + 1))
}

fn label_of(row: &TableRow) -> Option<Label> {
    row.get("label").and_then(Value::as_str).and_then(Label::named)
}

/// The label of a whole instance: that of the greatest mean log probability, among those that instances have.
fn most_probable(found: &Probabilities, labels: &[Label]) -> Label {
    let score = |label: &Label| found.p.iter().map(|p| p[label.index()].max(1e-9).ln()).sum::<f64>();
    labels.iter().copied().max_by(|a, b| score(a).total_cmp(&score(b))).unwrap_or(Label::Moving)
}

/// An instance as each row of the table sees it.
fn motions(rows: &[(usize, &TableRow)], path: &Path) -> Result<[Motion; 3], EvalError> {
    let number = |(place, row): &(usize, &TableRow), name: &str| {
        let number = row.get(name).and_then(Value::as_f64);
        number.ok_or_else(|| bad(path, *place, &format!("{name} is missing or no number")))
    };
    let column = |name: &str| rows.iter().map(|row| number(row, name)).collect::<Result<Vec<f64>, _>>();
    let pairs = |x: Vec<f64>, y: Vec<f64>| x.into_iter().zip(y).map(|(x, y)| [x, y]).collect::<Vec<_>>();
    let time_s = column("time_s")?;
    let [x0, y0, x1, y1] = ["bbox_x0_px", "bbox_y0_px", "bbox_x1_px", "bbox_y1_px"].map(column);
    let (x0, y0, x1, y1) = (x0?, y0?, x1?, y1?);
    let boxes: Vec<[f64; 4]> = (0..time_s.len()).map(|i| [x0[i], y0[i], x1[i], y1[i]]).collect();
    Ok([
        picture_motion(&time_s, &boxes, PICTURE_HEIGHT_PX, false),
        picture_motion(&time_s, &boxes, PICTURE_HEIGHT_PX, true),
        Motion {
            xy_m: pairs(column("x_m")?, column("y_m")?),
            sd_m: pairs(column("x_sd_m")?, column("y_sd_m")?),
            time_s,
            ..Motion::default()
        },
    ])
}
