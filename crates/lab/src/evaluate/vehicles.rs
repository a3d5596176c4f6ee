//! A run against vehicles that other sensors tracked (`roadplane.vehicles/1`). Their positions are in another world
//! frame, so the two worlds are aligned first.

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

/// Schema of the file.
const SCHEMA: &str = "roadplane.vehicles/1";
/// Smaller vehicles (longer side of the box, px) need not be found, and their tracks do not count.
const MIN_SIDE_PX: f64 = 30.0;
/// Boxes that overlap less belong to different vehicles.
const MIN_IOU: f64 = 0.3;
/// Class of trailers, which are no vehicles of their own.
const TRAILER: &str = "trailer";
/// Rounds of the fit. Each round leaves out the pairs that the round before left too far apart.
const ROUNDS: usize = 5;
/// Largest distance of a pair that takes part in the next round, m.
const FIT_M: f64 = 4.0;

/// The file of vehicles.
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

/// The rows of a frame that count, each with the index of the vehicle (of all vehicles) whose box overlaps most.
struct Paired<'a> {
    vehicles: &'a [Vehicle],
    rows: Vec<(&'a TrackRow, Option<usize>)>,
}

/// Scores a run against a file of vehicles.
///
/// # Errors
/// [`LabError`] for a file that cannot be read or has another form, and for a run without a common vehicle.
pub fn against_vehicles(run: &FinishedRun, path: &Path, name: &str) -> Result<Report, LabError> {
    let truth: Vehicles =
        serde_json::from_str(&read_text(path)?).map_err(|e| LabError::malformed(path, e))?;
    if truth.schema != SCHEMA {
        let what = format!("{}: schema is {:?}, expected {SCHEMA:?}", path.display(), truth.schema);
        return Err(LabError::unsuitable(what));
    }
    // Sensors need a moment to find their first vehicles, so frames without vehicles are no truth.
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

/// Pairs the rows of a frame with vehicles. Left out are rows on a vehicle that does not count, and small or filled-in
/// rows on no vehicle, as in `score_tracks`.
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

fn robust_fit(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Similarity> {
    let mut fit = Similarity::fit(pairs)?;
    for _ in 0..ROUNDS {
        let near = |(from, to): &&(Vector2<f64>, Vector2<f64>)| (fit.apply(from) - to).norm() < FIT_M;
        fit = Similarity::fit(&pairs.iter().filter(near).copied().collect::<Vec<_>>())?;
    }
    Some(fit)
}
