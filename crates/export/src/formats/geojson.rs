//! GeoJSON (RFC 7946): tracks as lines, and rows as points.
//!
//! If the run has a position on the map, the coordinates are longitude and latitude. Otherwise the coordinates are
//! metres from the point on the ground below the camera. The standard does not support metres, so other tools may
//! misread them as degrees. The property `coordinate_system` names the unit.

use std::path::Path;

use roadplane_base::TrackRow;
use roadplane_write::{WriteError, write_json};
use serde_json::{Map, Value, json};

use super::files::write_place;
use crate::{Run, RunSegment, Track};

const METRES: &str =
    "metres from the camera's foot, x to the right, y the viewing direction; NOT longitude and latitude";
const DEGREES: &str = "longitude and latitude in degrees, WGS 84";

/// Writes two files per segment: one file with a line for each track, and one file with a point for each row.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for segment in &run.segments {
        let file = |kind: &str| folder.join(format!("{}.{kind}.geojson", segment.name));
        write_json(&file("tracks"), &paths(run, segment))?;
        let rows = run.rows().into_iter().filter(|(_, row)| segment.contains(row));
        let points = rows.map(|(track, row)| point(track, row)).collect();
        write_json(&file("rows"), &collection(run, segment, points))?;
    }
    write_place(run, folder)
}

/// Writes a GeoJSON file with the path of each track as a line. Only the first segment of the run is written.
///
/// # Errors
/// [`WriteError::Io`], [`WriteError::DiskFull`].
pub fn write_paths(run: &Run, path: &Path) -> Result<(), WriteError> {
    run.segments.first().map_or(Ok(()), |segment| write_json(path, &paths(run, segment)))
}

fn paths(run: &Run, segment: &RunSegment) -> Value {
    let in_segment =
        |track: &Track| track.rows.iter().filter(|row| segment.contains(row)).cloned().collect::<Vec<_>>();
    let lines = run.tracks.iter().filter_map(|track| line(track, &in_segment(track))).collect();
    collection(run, segment, lines)
}

fn collection(run: &Run, segment: &RunSegment, features: Vec<Value>) -> Value {
    json!({
        "type": "FeatureCollection",
        "name": segment.name,
        "media": run.media,
        "coordinate_system": if run.place.is_some() { DEGREES } else { METRES },
        "utm_zone": run.place.as_ref().map(|place| place.zone.as_str()),
        "features": features,
    })
}

fn coordinates(row: &TrackRow) -> Value {
    match &row.on_map {
        Some(at) => json!([at.longitude, at.latitude]),
        None => json!([row.x_m, row.y_m]),
    }
}

/// Returns the path of a track as a GeoJSON line; `None` if there are no rows. A single row gives a line with two equal
/// ends.
fn line(track: &Track, rows: &[TrackRow]) -> Option<Value> {
    let (first, last) = (rows.first()?, rows.last()?);
    let mut path: Vec<Value> = rows.iter().map(coordinates).collect();
    if path.len() == 1 {
        path.push(coordinates(last));
    }
    let of = |value: fn(&TrackRow) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    Some(json!({
        "type": "Feature",
        "id": track.id,
        "geometry": {"type": "LineString", "coordinates": path},
        "properties": {
            "track": track.id,
            "class": track.class.name(),
            "length_m": first.length_m, "width_m": first.width_m, "height_m": first.height_m,
            "from_s": first.time_s, "to_s": last.time_s,
            "frame": rows.iter().map(|row| row.frame).collect::<Vec<u64>>(),
            "time_s": of(|row| row.time_s),
            "heading_rad": of(|row| row.heading_rad),
            "speed_mps": of(|row| row.speed_mps),
            "observed": rows.iter().map(|row| row.observed).collect::<Vec<bool>>(),
        },
    }))
}

/// Returns a row as a GeoJSON point. Its properties are all columns of the row.
fn point(track: &Track, row: &TrackRow) -> Value {
    let mut properties = match serde_json::to_value(row) {
        Ok(Value::Object(columns)) => columns,
        _ => Map::new(),
    };
    properties.insert("class".to_owned(), json!(track.class.name()));
    json!({
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": coordinates(row)},
        "properties": properties,
    })
}
