//! KML (OGC, with Google's extension `gx:Track`): one placemark for each track, with its path over time.
//!
//! A path has the position of the vehicle in each row and the time of each position. Coordinates are longitude and
//! latitude (WGS 84), on the ground. If the start of the recording is unknown, it is the start of 1970 (UTC).

use std::path::Path;

use roadplane_base::TrackRow;
use roadplane_write::{WriteError, civil_time};

use super::files::write_place;
use crate::{Element, Run, Track, fixed};

/// Returns the reason why a run cannot be written as KML; `None` if it can be written.
pub fn lacks(run: &Run) -> Option<String> {
    let reason = "needs a position on the map, and the run has none (give --geo or --camera-at)";
    run.place.is_none().then(|| reason.to_owned())
}

/// Writes one file. A run with a position on the map has only one segment.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    let placemarks = run.tracks.iter().map(|track| placemark(run, track));
    let document = Element::new("Document").holding([
        Element::text("name", &run.name),
        Element::new("Schema").with("id", "row").holding([
            array("heading_deg", "heading, degrees clockwise from grid north"),
            array("speed_mps", "speed, m/s"),
            array("observed", "1 if the vehicle was detected in the frame, else 0"),
        ]),
    ]);
    let kml = Element::new("kml")
        .with("xmlns", "http://www.opengis.net/kml/2.2")
        .with("xmlns:gx", "http://www.google.com/kml/ext/2.2")
        .holding([document.holding(placemarks)]);
    kml.write(&folder.join(format!("{}.kml", run.name)))?;
    write_place(run, folder)
}

fn array(name: &str, meaning: &str) -> Element {
    let array = Element::new("gx:SimpleArrayField").with("name", name).with("type", "float");
    array.holding([Element::text("displayName", meaning)])
}

fn placemark(run: &Run, track: &Track) -> Element {
    let [length, width, height] = track.dims_m().map(|metres| fixed(metres, 4));
    let data = |name: &str, value: &str| {
        Element::new("Data").with("name", name).holding([Element::text("value", value)])
    };
    let about = Element::new("ExtendedData").holding([
        data("track", &track.id.to_string()),
        data("class", track.class.name()),
        data("length_m", &length),
        data("width_m", &width),
        data("height_m", &height),
    ]);
    Element::new("Placemark").with("id", format!("track_{}", track.id)).holding([
        Element::text("name", format!("{} {}", track.class.name(), track.id)),
        about,
        path(run, track),
    ])
}

fn path(run: &Run, track: &Track) -> Element {
    let times = track.rows.iter().map(|row| Element::text("when", time(run, row)));
    let places = track.rows.iter().filter_map(|row| {
        let at = row.on_map.as_ref()?;
        Some(Element::text("gx:coord", format!("{} {} 0", fixed(at.longitude, 9), fixed(at.latitude, 9))))
    });
    let values = |name: &str, of: fn(&TrackRow) -> String| {
        let values = track.rows.iter().map(|row| Element::text("gx:value", of(row)));
        Element::new("gx:SimpleArrayData").with("name", name).holding(values)
    };
    let values = Element::new("SchemaData").with("schemaUrl", "#row").holding([
        values("heading_deg", |row| fixed(row.on_map.as_ref().map_or(0.0, |at| at.bearing_deg), 3)),
        values("speed_mps", |row| fixed(row.speed_mps, 4)),
        values("observed", |row| u8::from(row.observed).to_string()),
    ]);
    Element::new("gx:Track")
        .holding([Element::text("altitudeMode", "clampToGround")])
        .holding(times)
        .holding(places)
        .holding([Element::new("ExtendedData").holding([values])])
}

/// Returns the time of a row as XML Schema's `dateTime`, UTC, with microseconds.
fn time(run: &Run, row: &TrackRow) -> String {
    let micros = (row.time_s * 1e6).round() as i64;
    let second = run.start_s.unwrap_or(0) + micros.div_euclid(1_000_000);
    format!("{}.{:06}Z", civil_time(second), micros.rem_euclid(1_000_000))
}
