//! GeoJSON (RFC 7946). Without a place on the map coordinates are metres from the camera's foot, which the standard has no
//! form for: `coordinate_system` says so, and tools that take them for degrees are wrong.

use std::path::Path;

use roadplane_base::{TrackRow, VehicleClass};
use roadplane_write::{WriteError, write_json};
use serde_json::{Map, Value, json};

use crate::{Run, Stretch, Track};

const METRES: &str =
    "metres from the camera's foot, x to the right, y the viewing direction; NOT longitude and latitude";

/// A line a track and a point a row, for each stretch of time.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for stretch in &run.stretches {
        let file = |kind: &str| folder.join(format!("{}.{kind}.geojson", stretch.name));
        let lines = run.tracks.iter().filter_map(|track| line(track, stretch)).collect();
        write_json(&file("tracks"), &collection(run, stretch, lines))?;
        let rows = run.rows();
        let here = rows.iter().filter(|(_, row)| stretch.holds(row));
        write_json(
            &file("rows"),
            &collection(run, stretch, here.map(|(track, row)| point(track, row)).collect()),
        )?;
    }
    Ok(())
}

fn collection(run: &Run, stretch: &Stretch, features: Vec<Value>) -> Value {
    json!({
        "type": "FeatureCollection",
        "name": stretch.name,
        "media": run.media,
        "coordinate_system": METRES,
        "features": features,
    })
}

fn coordinates(row: &TrackRow) -> Value {
    json!([row.x_m, row.y_m])
}

fn class(track: &Track) -> Value {
    json!(match track.class {
        VehicleClass::Car => "car",
        VehicleClass::Truck => "truck",
        VehicleClass::Bus => "bus",
    })
}

/// A track's way; one that has a single row is a line from there to there.
fn line(track: &Track, stretch: &Stretch) -> Option<Value> {
    let rows: Vec<&TrackRow> = track.rows.iter().filter(|row| stretch.holds(row)).collect();
    let (first, last) = (rows.first()?, rows.last()?);
    let mut way: Vec<Value> = rows.iter().map(|row| coordinates(row)).collect();
    if way.len() == 1 {
        way.push(coordinates(last));
    }
    let of = |value: fn(&TrackRow) -> f64| rows.iter().map(|row| value(row)).collect::<Vec<f64>>();
    Some(json!({
        "type": "Feature",
        "id": track.id,
        "geometry": {"type": "LineString", "coordinates": way},
        "properties": {
            "track": track.id,
            "class": class(track),
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

/// A row with all its columns.
fn point(track: &Track, row: &TrackRow) -> Value {
    let mut properties = match serde_json::to_value(row) {
        Ok(Value::Object(columns)) => columns,
        _ => Map::new(),
    };
    properties.insert("class".to_owned(), class(track));
    json!({
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": coordinates(row)},
        "properties": properties,
    })
}
