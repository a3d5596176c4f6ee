//! highD (Krajewski et al. 2018): three tables for each recording.
//!
//! The format is meant for straight roads. The x axis points in the main driving direction, and the y axis points to
//! the right of that direction. Boxes are parallel to the axes. The position of a box is its corner with the smallest x
//! and y. The column `xAxisHeading` of the recording is the heading of the x axis in the world frame of the run, rad.
//!
//! A run contains no lanes, so all columns about lanes are 0.

use std::path::Path;

use nalgebra::{Rotation2, Vector2};
use roadplane_base::{TrackRow, VehicleClass};
use roadplane_write::WriteError;

use super::csv_table::write_table;
use crate::{Run, RunSegment, Track, fixed};

/// Speed above which a row is used for the main driving direction, m/s.
const DRIVING_MPS: f64 = 1.0;

/// Columns for which a run has no values: viewing distances, neighbouring vehicles and lane.
const NEIGHBOURS: [&str; 15] = [
    "frontSightDistance",
    "backSightDistance",
    "dhw",
    "thw",
    "ttc",
    "precedingXVelocity",
    "precedingId",
    "followingId",
    "leftPrecedingId",
    "leftAlongsideId",
    "leftFollowingId",
    "rightPrecedingId",
    "rightAlongsideId",
    "rightFollowingId",
    "laneId",
];
/// Columns for which a run has values.
const MEASURED: [&str; 10] =
    ["frame", "id", "x", "y", "width", "height", "xVelocity", "yVelocity", "xAcceleration", "yAcceleration"];

/// Writes the three tables of each segment. Each segment is one recording.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for (number, segment) in run.segments.iter().enumerate() {
        let heading = main_direction(run, segment);
        let file = |kind: &str| folder.join(format!("{}_{kind}.csv", segment.name));
        let mut header = [""; 25];
        header[..10].copy_from_slice(&MEASURED);
        header[10..].copy_from_slice(&NEIGHBOURS);
        write_table(&file("tracks"), &header, track_rows(run, segment, heading))?;
        write_table(
            &file("tracksMeta"),
            &META_HEADER,
            run.tracks.iter().filter_map(|t| meta(t, segment, heading)),
        )?;
        write_table(&file("recordingMeta"), &RECORDING_HEADER, [recording(run, segment, number, heading)])?;
    }
    Ok(())
}

/// Returns the heading of the main driving direction in the world frame, rad.
///
/// All headings are doubled and averaged, weighted by driven distance. Doubled headings are equal for both directions
/// of a road. So half of the mean is the heading of the road's axis. The result is the direction along the axis with
/// more driven distance.
fn main_direction(run: &Run, segment: &RunSegment) -> f64 {
    let driven = || {
        let rows = run.tracks.iter().flat_map(|track| &track.rows);
        rows.filter(|row| segment.contains(row) && row.speed_mps.abs() > DRIVING_MPS)
    };
    let doubled: Vector2<f64> =
        driven().map(|row| weighted(2.0 * row.heading_rad, row.speed_mps.abs())).sum();
    let axis = doubled.y.atan2(doubled.x) / 2.0;
    let along: f64 = driven().map(|row| row.speed_mps * (row.heading_rad - axis).cos()).sum();
    if along < 0.0 { axis + std::f64::consts::PI } else { axis }
}

fn weighted(angle: f64, weight: f64) -> Vector2<f64> {
    Vector2::new(angle.cos(), angle.sin()) * weight
}

/// State of a vehicle in the axes of the recording: x along the main driving direction, y to the right of that
/// direction. Lengths are in m.
struct Along {
    corner: Vector2<f64>,
    size: Vector2<f64>,
    velocity: Vector2<f64>,
    acceleration: Vector2<f64>,
}

impl Along {
    fn new(track: &Track, row: &TrackRow, acceleration: f64, axis: f64) -> Self {
        let turned = |v: Vector2<f64>| {
            let v = Rotation2::new(-axis) * v;
            Vector2::new(v.x, -v.y)
        };
        let direction = turned(weighted(row.heading_rad, 1.0));
        let (along, across) = (direction.abs(), Vector2::new(direction.y.abs(), direction.x.abs()));
        let size = along * row.length_m + across * row.width_m;
        Self {
            corner: turned(track.body_centre(row)) - size / 2.0,
            size,
            velocity: direction * row.speed_mps,
            acceleration: direction * acceleration,
        }
    }
}

fn track_rows(run: &Run, segment: &RunSegment, axis: f64) -> Vec<[String; 25]> {
    let mut lines = Vec::new();
    for track in &run.tracks {
        for (row, acceleration) in track.rows.iter().zip(track.accelerations()) {
            if !segment.contains(row) {
                continue;
            }
            let car = Along::new(track, row, acceleration, axis);
            let mut line = [const { String::new() }; 25];
            line.fill("0".to_owned());
            line[0] = row.frame.to_string();
            line[1] = track.id.to_string();
            for (i, v) in [car.corner, car.size, car.velocity, car.acceleration].iter().enumerate() {
                line[2 + 2 * i] = fixed(v.x, 4);
                line[3 + 2 * i] = fixed(v.y, 4);
            }
            lines.push(line);
        }
    }
    lines
}

const META_HEADER: [&str; 16] = [
    "id",
    "width",
    "height",
    "initialFrame",
    "finalFrame",
    "numFrames",
    "class",
    "drivingDirection",
    "traveledDistance",
    "minXVelocity",
    "maxXVelocity",
    "meanXVelocity",
    "minDHW",
    "minTHW",
    "minTTC",
    "numLaneChanges",
];

fn meta(track: &Track, segment: &RunSegment, axis: f64) -> Option<[String; 16]> {
    let rows: Vec<&TrackRow> = track.rows.iter().filter(|row| segment.contains(row)).collect();
    let (first, last) = (rows.first()?, rows.last()?);
    let speeds: Vec<f64> = rows.iter().map(|row| row.speed_mps * (row.heading_rad - axis).cos()).collect();
    let driven_m: f64 =
        rows.windows(2).map(|pair| (pair[1].x_m - pair[0].x_m).hypot(pair[1].y_m - pair[0].y_m)).sum();
    let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
    let absolute = || speeds.iter().map(|v| v.abs());
    let class = if track.class == VehicleClass::Car { "Car" } else { "Truck" };
    // 1 is against the direction of the x axis (the upper lanes), and 2 is along the x axis.
    let direction = if (first.heading_rad - axis).cos() < 0.0 { "1" } else { "2" };
    Some([
        track.id.to_string(),
        fixed(first.length_m, 4),
        fixed(first.width_m, 4),
        first.frame.to_string(),
        last.frame.to_string(),
        rows.len().to_string(),
        class.to_owned(),
        direction.to_owned(),
        fixed(driven_m, 4),
        fixed(absolute().fold(f64::INFINITY, f64::min), 4),
        fixed(absolute().fold(0.0, f64::max), 4),
        fixed(mean.abs(), 4),
        "0".to_owned(),
        "0".to_owned(),
        "0".to_owned(),
        "0".to_owned(),
    ])
}

const RECORDING_HEADER: [&str; 11] = [
    "id",
    "frameRate",
    "duration",
    "numVehicles",
    "numCars",
    "numTrucks",
    "speedLimit",
    "locationId",
    "upperLaneMarkings",
    "lowerLaneMarkings",
    "xAxisHeading",
];

fn recording(run: &Run, segment: &RunSegment, number: usize, axis: f64) -> [String; 11] {
    let here: Vec<&Track> =
        run.tracks.iter().filter(|track| track.rows.iter().any(|row| segment.contains(row))).collect();
    let cars = here.iter().filter(|track| track.class == VehicleClass::Car).count();
    let [from, to] = segment.camera.span_s;
    [
        (number + 1).to_string(),
        fixed(run.frames_per_s, 3),
        fixed(to - from, 3),
        here.len().to_string(),
        cars.to_string(),
        (here.len() - cars).to_string(),
        "-1".to_owned(),
        "0".to_owned(),
        String::new(),
        String::new(),
        fixed(axis, 5),
    ]
}
