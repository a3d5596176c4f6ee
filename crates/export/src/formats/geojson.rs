//! GeoJSON (RFC 7946): longitude and latitude where the run's place on the map is known. Otherwise coordinates are metres from
//! the camera's foot, which the standard has no form for: `coordinate_system` says so, and tools that take them for degrees are
//! wrong.

use std::path::Path;

use roadplane_base::TrackRow;
use roadplane_write::{WriteError, write_json};
use serde_json::{Map, Value, json};

use super::files::write_place;
use crate::{Run, Stretch, Track};

const METRES: &str =
    "metres from the camera's foot, x to the right, y the viewing direction; NOT longitude and latitude";
const DEGREES: &str = "longitude and latitude in degrees, WGS 84";

/// A line a track and a point a row, for each stretch of time.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for stretch in &run.stretches {
        let file = |kind: &str| folder.join(format!("{}.{kind}.geojson", stretch.name));
        write_json(&file("tracks"), &ways(run, stretch))?;
        let rows = run.rows().into_iter().filter(|(_, row)| stretch.holds(row));
        let points = rows.map(|(track, row)| point(track, row)).collect();
        write_json(&file("rows"), &collection(run, stretch, points))?;
    }
    write_place(run, folder)
}

/// Writes a run's tracks as lines, where the camera was not moved: `tracks.geojson`.
///
/// # Errors
/// [`WriteError::Io`], [`WriteError::DiskFull`].
pub fn write_ways(run: &Run, path: &Path) -> Result<(), WriteError> {
    run.stretches.first().map_or(Ok(()), |stretch| write_json(path, &ways(run, stretch)))
}

fn ways(run: &Run, stretch: &Stretch) -> Value {
    let of_stretch =
        |track: &Track| track.rows.iter().filter(|row| stretch.holds(row)).cloned().collect::<Vec<_>>();
    let lines = run.tracks.iter().filter_map(|track| line(track, &of_stretch(track))).collect();
    collection(run, stretch, lines)
}

fn collection(run: &Run, stretch: &Stretch, features: Vec<Value>) -> Value {
    json!({
        "type": "FeatureCollection",
        "name": stretch.name,
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

/// A track's way; one that has a single row is a line from there to there.
fn line(track: &Track, rows: &[TrackRow]) -> Option<Value> {
    let (first, last) = (rows.first()?, rows.last()?);
    let mut way: Vec<Value> = rows.iter().map(coordinates).collect();
    if way.len() == 1 {
        way.push(coordinates(last));
    }
    let of = |value: fn(&TrackRow) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    Some(json!({
        "type": "Feature",
        "id": track.id,
        "geometry": {"type": "LineString", "coordinates": way},
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

/// A row with all its columns.
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
