//! Scores a run against vehicles that other sensors tracked (file of schema `roadplane.vehicles/1`).
//!
//! The file has its own world frame. Therefore the positions of the run are aligned with that frame first.

use std::collections::BTreeSet;
use std::path::Path;

use nalgebra::Vector2;
use roadplane_base::{Similarity, TrackRow, angle_difference, assign, bbox_iou};
use roadplane_tables::{Cell, Column, Report, Table, quantile};
use serde::Deserialize;

use crate::LabError;
use crate::finished_run::FinishedRun;
use roadplane_metrics::clear::Clear;
use roadplane_metrics::hota::HotaCounts;
use roadplane_metrics::identity::Identity;
use roadplane_metrics::sequence::{Sequence, SequenceFrame};
use roadplane_metrics::text_file::read_text;

/// Schema of the file of vehicles.
const SCHEMA: &str = "roadplane.vehicles/1";
/// Minimum length of the longer side of a scored vehicle's box, px. Tracks of smaller vehicles are ignored.
const MIN_SIDE_PX: f64 = 30.0;
/// Least overlap (IoU) of two boxes that belong to one vehicle.
const MIN_IOU: f64 = 0.3;
/// Class of trailers. A trailer is not scored as a separate vehicle.
const TRAILER: &str = "trailer";
/// Number of rounds of the alignment. It changes little after about ten.
const ROUNDS: usize = 30;
/// Distance between the two positions of a pair at which its weight in the alignment is a half, m. It is about the
/// median distance.
const FIT_M: f64 = 1.0;

/// The content of a file of vehicles.
#[derive(Debug, Deserialize)]
struct Vehicles {
    schema: String,
    frames: Vec<VehicleFrame>,
}

#[derive(Debug, Deserialize)]
struct VehicleFrame {
    frame: u64,
    vehicles: Vec<Vehicle>,
}

#[derive(Debug, Deserialize)]
struct Vehicle {
    id: u64,
    class: String,
    x_m: f64,
    y_m: f64,
    heading_rad: f64,
    bbox_px: [f64; 4],
}

impl Vehicle {
    fn counts(&self) -> bool {
        self.class != TRAILER && longer_side(&self.bbox_px) >= MIN_SIDE_PX
    }

    fn position(&self) -> Vector2<f64> {
        Vector2::new(self.x_m, self.y_m)
    }
}

fn longer_side([x0, y0, x1, y1]: &[f64; 4]) -> f64 {
    (x1 - x0).max(y1 - y0)
}

fn position(row: &TrackRow) -> Vector2<f64> {
    Vector2::new(row.x_m, row.y_m)
}

/// The true vehicles of a frame, and the scored rows of the run. Each row has the index of the vehicle that its box
/// matches.
struct Paired<'a> {
    vehicles: &'a [Vehicle],
    rows: Vec<(&'a TrackRow, Option<usize>)>,
}

/// Scores a run against a file of vehicles that other sensors tracked.
///
/// # Errors
/// [`LabError`] if the file cannot be read or has another format, or if no track of the run matches a vehicle of the
/// file.
pub fn against_vehicles(run: &FinishedRun, path: &Path, name: &str) -> Result<Report, LabError> {
    let truth: Vehicles =
        serde_json::from_str(&read_text(path)?).map_err(|e| LabError::malformed(path, e))?;
    if truth.schema != SCHEMA {
        let what = format!("{}: schema is {:?}, expected {SCHEMA:?}", path.display(), truth.schema);
        return Err(LabError::unsuitable(what));
    }
    // The sensors find the first vehicles only after a moment, so frames without vehicles are left out.
    let frames: Vec<&VehicleFrame> = truth.frames.iter().filter(|frame| !frame.vehicles.is_empty()).collect();
    let paired: Vec<Paired<'_>> = frames.iter().map(|frame| pair(run, frame)).collect();
    let pairs: Vec<(Vector2<f64>, Vector2<f64>)> = paired
        .iter()
        .flat_map(|frame| frame.rows.iter().map(move |(row, vehicle)| (frame, row, vehicle)))
        .filter_map(|(frame, row, vehicle)| Some((position(row), frame.vehicles[(*vehicle)?].position())))
        .collect();
    let Some(fit) = robust_fit(&pairs) else {
        return Err(LabError::unsuitable("no track lies on a vehicle of the truth"));
    };
    let mut sequence: Sequence = Vec::new();
    let (mut positions, mut headings, mut ids) = (Vec::new(), Vec::new(), BTreeSet::new());
    for frame in &paired {
        let counted: Vec<&Vehicle> = frame.vehicles.iter().filter(|vehicle| vehicle.counts()).collect();
        ids.extend(counted.iter().map(|vehicle| vehicle.id));
        let truths: Vec<_> = counted.iter().map(|vehicle| (vehicle.id, vehicle.position())).collect();
        let founds: Vec<_> =
            frame.rows.iter().map(|(row, _)| (row.track, fit.apply(&position(row)))).collect();
        sequence.push(SequenceFrame::on_ground(&truths, &founds));
        for (row, vehicle) in &frame.rows {
            let Some(vehicle) = vehicle.map(|v| &frame.vehicles[v]) else { continue };
            positions.push((fit.apply(&position(row)) - vehicle.position()).norm());
            headings.push(angle_difference(row.heading_rad + fit.turn(), vehicle.heading_rad).abs());
        }
    }
    let (hota, clear) = (HotaCounts::of(&sequence).score(), Clear::of(&sequence));
    let heads = [
        ("run", 0),
        ("vehicles", 0),
        ("pairs", 0),
        ("scale", 3),
        ("HOTA, %", 1),
        ("DetA, %", 1),
        ("AssA, %", 1),
        ("IDF1, %", 1),
        ("switches", 0),
        ("position, median m", 2),
        ("90 % within, m", 2),
        ("heading, median °", 1),
    ];
    let note = "After the turn, shift and scale that align the run's positions with the true ones. Vehicles of 30 px \
        and more, no trailers. Boxes pair them; identity counts within 2 m on the ground.";
    let columns = heads.iter().map(|(head, decimals)| Column::new(*head, *decimals)).collect();
    let mut table = Table::new("Tracks against other sensors", note, columns);
    let numbers = [
        ids.len() as f64,
        pairs.len() as f64,
        fit.log_scale().exp(),
        100.0 * hota.hota,
        100.0 * hota.det_a,
        100.0 * hota.ass_a,
        100.0 * Identity::of(&sequence).idf1(),
        clear.switches as f64,
        quantile(&positions, 0.5),
        quantile(&positions, 0.9),
        quantile(&headings, 0.5).to_degrees(),
    ];
    table.rows.push(std::iter::once(Cell::from(name)).chain(numbers.map(Cell::from)).collect());
    Ok(Report {
        title: format!("Run {name} against other sensors"),
        tables: vec![table],
        ..Report::default()
    })
}

/// Pairs the rows of a frame with the true vehicles.
///
/// As in `score_tracks`, two kinds of rows are left out: rows on a vehicle that is not scored, and small or
/// interpolated rows without a vehicle.
fn pair<'a>(run: &'a FinishedRun, frame: &'a VehicleFrame) -> Paired<'a> {
    let rows: Vec<&TrackRow> = run.rows.iter().filter(|row| row.frame == frame.frame).collect();
    let vehicle_of = assign(rows.len(), frame.vehicles.len(), 1.0 - MIN_IOU, |i, j| {
        1.0 - bbox_iou(&rows[i].bbox_px, &frame.vehicles[j].bbox_px)
    });
    let keep = |(row, vehicle): &(&TrackRow, Option<usize>)| match vehicle {
        Some(vehicle) => frame.vehicles[*vehicle].counts(),
        None => row.observed && longer_side(&row.bbox_px) >= MIN_SIDE_PX,
    };
    Paired { vehicles: &frame.vehicles, rows: rows.into_iter().zip(vehicle_of).filter(keep).collect() }
}

/// Fits a similarity by iterated weights for errors of a Cauchy distribution (Holland and Welsch 1977).
///
/// Boxes that hide each other are sometimes paired with the wrong vehicle. Such pairs hardly count.
fn robust_fit(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Similarity> {
    let mut fit = Similarity::fit(pairs)?;
    for _ in 0..ROUNDS {
        let distances: Vec<f64> = pairs.iter().map(|(from, to)| (fit.apply(from) - to).norm()).collect();
        fit = Similarity::fit_weighted(pairs, |i| 1.0 / (1.0 + (distances[i] / FIT_M).powi(2)))?;
    }
    Some(fit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_pairs_do_not_move_the_alignment() {
        let moved = |p: Vector2<f64>| Vector2::new(3.0 - 1.1 * p.y, 1.1 * p.x - 2.0);
        let mut pairs: Vec<_> = (0..30_u32)
            .map(|i| Vector2::new(f64::from(i % 6) * 4.0, f64::from(i / 6) * 7.0))
            .map(|p| (p, moved(p)))
            .collect();
        // A third of the pairs belongs to two vehicles whose boxes were paired with their neighbours'.
        pairs.extend((0..8).map(|_| (Vector2::new(18.0, 25.0), moved(Vector2::new(15.0, 20.0)))));
        pairs.extend((0..7).map(|_| (Vector2::new(20.0, 2.0), moved(Vector2::new(17.0, 5.0)))));
        let fit = robust_fit(&pairs).unwrap();
        for (from, to) in &pairs[..30] {
            assert!((fit.apply(from) - to).norm() < 0.25, "{from:?}");
        }
        assert!((fit.log_scale().exp() - 1.1).abs() < 0.01);
    }
}
