//! SUMO's floating car data: a list of time steps, each with its vehicles.
//!
//! In SUMO, the position of a vehicle is the middle of its front bumper. The angle of a vehicle is measured clockwise
//! from the y axis, in degrees. Each vehicle has its own vehicle type, which contains the vehicle's dimensions.

use std::path::Path;

use roadplane_base::{TrackRow, VehicleClass};
use roadplane_write::WriteError;

use super::files::by_frame;
use crate::{Element, Run, RunSegment, Track, fixed};

/// Writes two files per segment: the time steps, and the vehicle types.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for segment in &run.segments {
        steps(run, segment).write(&folder.join(format!("{}.fcd.xml", segment.name)))?;
        types(run).write(&folder.join(format!("{}.vtypes.xml", segment.name)))?;
    }
    Ok(())
}

fn steps(run: &Run, segment: &RunSegment) -> Element {
    let step = |rows: &Vec<(&Track, &TrackRow)>| {
        let time_s = rows.first().map_or(0.0, |(_, row)| row.time_s);
        let vehicles = rows.iter().map(|(track, row)| vehicle(track, row));
        Element::new("timestep").with("time", fixed(time_s, 6)).holding(vehicles)
    };
    Element::new("fcd-export").holding(by_frame(run, segment).values().map(step))
}

fn vehicle(track: &Track, row: &TrackRow) -> Element {
    let front = track.front(row);
    let angle = (90.0 - row.heading_rad.to_degrees()).rem_euclid(360.0);
    Element::new("vehicle")
        .with("id", track.id)
        .with("x", fixed(front.x, 4))
        .with("y", fixed(front.y, 4))
        .with("angle", fixed(angle, 4))
        .with("type", type_name(track))
        .with("speed", fixed(row.speed_mps, 4))
}

fn type_name(track: &Track) -> String {
    format!("track_{}", track.id)
}

fn types(run: &Run) -> Element {
    let of_track = |track: &Track| {
        let [length, width, height] = track.dims_m();
        let class = match track.class {
            VehicleClass::Car => "passenger",
            VehicleClass::Truck => "truck",
            VehicleClass::Bus => "bus",
            VehicleClass::Motorcycle => "motorcycle",
        };
        Element::new("vType")
            .with("id", type_name(track))
            .with("vClass", class)
            .with("length", fixed(length, 4))
            .with("width", fixed(width, 4))
            .with("height", fixed(height, 4))
    };
    Element::new("additional").holding(run.tracks.iter().map(of_track))
}
