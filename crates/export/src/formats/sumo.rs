//! SUMO's floating car data: vehicles by time step. As there a vehicle's place is the middle of its front bumper, and its angle
//! is in degrees clockwise from the y axis. Each vehicle has a type of its own, which holds its dimensions.

use std::collections::BTreeMap;
use std::path::Path;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};
use roadplane_base::{TrackRow, VehicleClass};
use roadplane_write::{OutFile, WriteError};

use super::csv_table::fixed;
use crate::{Run, Stretch, Track};

/// Writes both files of each stretch of time.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for stretch in &run.stretches {
        let path = folder.join(format!("{}.fcd.xml", stretch.name));
        write_xml(&path, |xml| steps(run, stretch, xml))?;
        let path = folder.join(format!("{}.vtypes.xml", stretch.name));
        write_xml(&path, |xml| types(run, xml))?;
    }
    Ok(())
}

/// An XML file; `body` writes its root.
fn write_xml(
    path: &Path,
    body: impl FnOnce(&mut Writer<&mut OutFile>) -> std::io::Result<()>,
) -> Result<(), WriteError> {
    let mut file = OutFile::create(path)?;
    let mut xml = Writer::new_with_indent(&mut file, b' ', 2);
    let failed = |source| WriteError::Io { doing: "write", source, path: path.to_path_buf() };
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None))).map_err(failed)?;
    body(&mut xml).map_err(failed)?;
    file.write_bytes(b"\n")?;
    file.finish()
}

fn steps(run: &Run, stretch: &Stretch, xml: &mut Writer<&mut OutFile>) -> std::io::Result<()> {
    let mut by_frame: BTreeMap<u64, Vec<(&Track, &TrackRow)>> = BTreeMap::new();
    for (track, row) in run.rows().into_iter().filter(|(_, row)| stretch.holds(row)) {
        by_frame.entry(row.frame).or_default().push((track, row));
    }
    xml.create_element("fcd-export")
        .write_inner_content(|xml| {
            for rows in by_frame.values() {
                let time = rows.first().map_or_else(String::new, |(_, row)| fixed(row.time_s, 6));
                xml.create_element("timestep").with_attribute(("time", time.as_str())).write_inner_content(
                    |xml| rows.iter().try_for_each(|(track, row)| vehicle(track, row, xml)),
                )?;
            }
            Ok(())
        })
        .map(|_| ())
}

fn vehicle(track: &Track, row: &TrackRow, xml: &mut Writer<&mut OutFile>) -> std::io::Result<()> {
    let front = track.front(row);
    let angle = (90.0 - row.heading_rad.to_degrees()).rem_euclid(360.0);
    xml.create_element("vehicle")
        .with_attributes([
            ("id", track.id.to_string().as_str()),
            ("x", fixed(front.x, 4).as_str()),
            ("y", fixed(front.y, 4).as_str()),
            ("angle", fixed(angle, 4).as_str()),
            ("type", type_name(track).as_str()),
            ("speed", fixed(row.speed_mps, 4).as_str()),
        ])
        .write_empty()
        .map(|_| ())
}

fn type_name(track: &Track) -> String {
    format!("track_{}", track.id)
}

fn types(run: &Run, xml: &mut Writer<&mut OutFile>) -> std::io::Result<()> {
    xml.create_element("additional")
        .write_inner_content(|xml| {
            for track in &run.tracks {
                let [length, width, height] = track.dims_m().map(|v| fixed(v, 4));
                let class = match track.class {
                    VehicleClass::Car => "passenger",
                    VehicleClass::Truck => "truck",
                    VehicleClass::Bus => "bus",
                };
                xml.create_element("vType")
                    .with_attributes([
                        ("id", type_name(track).as_str()),
                        ("vClass", class),
                        ("length", length.as_str()),
                        ("width", width.as_str()),
                        ("height", height.as_str()),
                    ])
                    .write_empty()?;
            }
            Ok(())
        })
        .map(|_| ())
}
