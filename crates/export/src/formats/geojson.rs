//! GeoJSON (RFC 7946): longitude and latitude where the run's place on the map is known. Otherwise coordinates are metres from
//! the camera's foot, which the standard has no form for: `coordinate_system` says so, and tools that take them for degrees are
//! wrong.

use std::path::Path;

use roadplane_base::TrackRow;
use roadplane_write::{WriteError, write_json};
use serde_json::{Map, Value, json};

use super::write_place;
use crate::{OnMap, Run, Stretch, Track, digits};

const METRES: &str =
    "metres from the camera's foot, x to the right, y the viewing direction; NOT longitude and latitude";
const DEGREES: &str = "longitude and latitude in degrees, WGS 84";

/// A row, and where it is on the map.
type Placed<'a> = (&'a Track, &'a TrackRow, Option<OnMap>);

/// A line a track and a point a row, for each stretch of time.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for stretch in &run.stretches {
        let file = |kind: &str| folder.join(format!("{}.{kind}.geojson", stretch.name));
        let placed = |(track, row)| Ok((track, row, run.on_map(row)?));
        let mut lines = Vec::new();
        for track in &run.tracks {
            let rows = track.rows_with().filter(|(_, row)| stretch.holds(row));
            lines.extend(line(&rows.map(placed).collect::<Result<Vec<Placed<'_>>, WriteError>>()?));
        }
        write_json(&file("tracks"), &collection(run, stretch, lines))?;
        let rows = run.rows().into_iter().filter(|(_, row)| stretch.holds(row)).map(placed);
        let points =
            rows.map(|row| row.map(|row: Placed<'_>| point(&row))).collect::<Result<_, WriteError>>()?;
        write_json(&file("rows"), &collection(run, stretch, points))?;
    }
    write_place(run, folder)
}

fn collection(run: &Run, stretch: &Stretch, features: Vec<Value>) -> Value {
    json!({
        "type": "FeatureCollection",
        "name": stretch.name,
        "media": run.media,
        "coordinate_system": if run.place.is_some() { DEGREES } else { METRES },
        "utm_zone": run.place.as_ref().map(|place| place.zone.name()),
        "features": features,
    })
}

fn coordinates((_, row, place): &Placed<'_>) -> Value {
    match place {
        // Nine decimals of a degree are a tenth of a millimetre.
        Some(OnMap { degrees: [latitude, longitude], .. }) => {
            json!([digits(*longitude, 9), digits(*latitude, 9)])
        }
        None => json!([row.x_m, row.y_m]),
    }
}

/// A track's way; one that has a single row is a line from there to there.
fn line(rows: &[Placed<'_>]) -> Option<Value> {
    let ((track, first, _), last) = (rows.first()?, rows.last()?);
    let mut way: Vec<Value> = rows.iter().map(coordinates).collect();
    if way.len() == 1 {
        way.push(coordinates(last));
    }
    let of = |value: fn(&TrackRow) -> f64| rows.iter().map(|(_, row, _)| value(row)).collect::<Vec<f64>>();
    Some(json!({
        "type": "Feature",
        "id": track.id,
        "geometry": {"type": "LineString", "coordinates": way},
        "properties": {
            "track": track.id,
            "class": track.class.name(),
            "length_m": first.length_m, "width_m": first.width_m, "height_m": first.height_m,
            "from_s": first.time_s, "to_s": last.1.time_s,
            "frame": rows.iter().map(|(_, row, _)| row.frame).collect::<Vec<u64>>(),
            "time_s": of(|row| row.time_s),
            "heading_rad": of(|row| row.heading_rad),
            "speed_mps": of(|row| row.speed_mps),
            "observed": rows.iter().map(|(_, row, _)| row.observed).collect::<Vec<bool>>(),
        },
    }))
}

/// A row with all its columns.
fn point(placed: &Placed<'_>) -> Value {
    let (track, row, place) = placed;
    let mut properties = match serde_json::to_value(row) {
        Ok(Value::Object(columns)) => columns,
        _ => Map::new(),
    };
    properties.insert("class".to_owned(), json!(track.class.name()));
    if let Some(OnMap { utm_m: [east, north], sd_m: [east_sd, north_sd], bearing_deg, .. }) = place {
        let columns =
            [("east_m", east), ("north_m", north), ("east_sd_m", east_sd), ("north_sd_m", north_sd)];
        for (name, value) in columns.into_iter().chain([("bearing_deg", bearing_deg)]) {
            properties.insert(name.to_owned(), json!(digits(*value, 4)));
        }
    }
    json!({
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": coordinates(placed)},
        "properties": properties,
    })
}
