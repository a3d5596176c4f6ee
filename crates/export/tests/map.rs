//! Files for maps are read back: GeoParquet and KML.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod fixture;
mod helpers;

use std::path::Path;

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::{Field, Row};
use quick_xml::events::Event;
use roadplane_base::TrackRow;
use roadplane_export::{Format, Run, export};
use roadplane_write::{Existing, WriteError};
use serde_json::{Value, json};

use fixture::run_folder;
use helpers::{close, export_to, exported, exported_on_map, rename_input};

/// Reads a GeoParquet file: its metadata under the key `geo`, and its rows.
fn parquet(path: &Path) -> (Value, Vec<Row>) {
    let reader = SerializedFileReader::new(std::fs::File::open(path).unwrap()).unwrap();
    let metadata = reader.metadata().file_metadata().key_value_metadata().unwrap().clone();
    let geo = metadata.iter().find(|entry| entry.key == "geo").unwrap().value.as_ref().unwrap();
    let rows = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
    (serde_json::from_str(geo).unwrap(), rows)
}

fn field<'a>(row: &'a Row, name: &str) -> &'a Field {
    row.get_column_iter().find(|(column, _)| *column == name).unwrap().1
}

fn number(row: &Row, name: &str) -> f64 {
    match field(row, name) {
        Field::Double(value) => *value,
        Field::Long(value) => *value as f64,
        other => panic!("{name} is {other}"),
    }
}

/// Reads the coordinates of a point or a line in well-known binary.
fn coordinates(row: &Row) -> (u32, Vec<[f64; 2]>) {
    let Field::Bytes(bytes) = field(row, "geometry") else { panic!("no geometry") };
    let bytes = bytes.data();
    let int = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let float = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    assert_eq!(bytes[0], 1, "little-endian");
    let (kind, from) = (int(1), if int(1) == 2 { 9 } else { 5 });
    let count = if kind == 2 { int(5) as usize } else { 1 };
    assert_eq!(bytes.len(), from + 16 * count);
    (kind, (0..count).map(|i| [float(from + 16 * i), float(from + 16 * i + 8)]).collect())
}

fn check_geoparquet(run: &Run, folder: &Path, position: fn(&TrackRow) -> [f64; 2]) -> [Value; 2] {
    let mut described = Vec::new();
    let (mut points, mut vertices) = (0, 0);
    for segment in &run.segments {
        let told: Vec<&TrackRow> =
            run.rows().into_iter().map(|(_, row)| row).filter(|row| segment.contains(row)).collect();
        let (geo, rows) = parquet(&folder.join(format!("{}.rows.parquet", segment.name)));
        described.push(geo);
        assert_eq!(rows.len(), told.len());
        points += rows.len();
        for (found, row) in rows.iter().zip(&told) {
            assert_eq!(coordinates(found), (1, vec![position(row)]));
            for (column, value) in [
                ("frame", row.frame as f64),
                ("track", row.track as f64),
                ("time_s", row.time_s),
                ("x_m", row.x_m),
                ("heading_rad", row.heading_rad),
                ("speed_mps", row.speed_mps),
            ] {
                assert_eq!(number(found, column), value, "{column}");
            }
        }
        let (geo, tracks) = parquet(&folder.join(format!("{}.tracks.parquet", segment.name)));
        described.push(geo);
        assert_eq!(tracks.len(), run.tracks.len());
        for found in &tracks {
            let of_track: Vec<&&TrackRow> =
                told.iter().filter(|row| row.track as f64 == number(found, "track")).collect();
            let path: Vec<[f64; 2]> = of_track.iter().map(|row| position(row)).collect();
            assert_eq!(coordinates(found), (2, path));
            assert_eq!(number(found, "rows"), of_track.len() as f64);
            assert_eq!(number(found, "from_s"), of_track[0].time_s);
            assert_eq!(number(found, "to_frame"), of_track[of_track.len() - 1].frame as f64);
            assert_eq!(number(found, "length_m"), of_track[0].length_m);
            vertices += of_track.len();
        }
    }
    assert_eq!((points, vertices), (run.rows().len(), run.rows().len()));
    [described.remove(0), described.remove(0)]
}

#[test]
fn geoparquet_without_a_map_has_metres_and_no_reference_system() {
    let (run, folder, _dir) = exported("geoparquet", true);
    let [rows, tracks] = check_geoparquet(&run, &folder, |row| [row.x_m, row.y_m]);
    for (geo, kind) in [(rows, "Point"), (tracks, "LineString")] {
        assert_eq!((&geo["version"], &geo["primary_column"]), (&json!("1.1.0"), &json!("geometry")));
        let column = geo["columns"]["geometry"].as_object().unwrap();
        assert_eq!(column["encoding"], "WKB");
        assert_eq!(column["geometry_types"], json!([kind]));
        assert!(column["crs"].is_null() && column.contains_key("crs"));
    }
}

#[test]
fn geoparquet_on_the_map_has_longitude_and_latitude() {
    let (run, folder, _dir) = exported_on_map("geoparquet");
    let degrees = |row: &TrackRow| row.on_map.as_ref().map(|at| [at.longitude, at.latitude]).unwrap();
    let [rows, _] = check_geoparquet(&run, &folder, degrees);
    let column = rows["columns"]["geometry"].as_object().unwrap();
    assert!(!column.contains_key("crs"), "the default is OGC:CRS84");
    let [west, south, east, north] = [0, 1, 2, 3].map(|i| column["bbox"][i].as_f64().unwrap());
    assert!(run.rows().iter().all(|(_, row)| {
        let [x, y] = degrees(row);
        (west..=east).contains(&x) && (south..=north).contains(&y)
    }));
    assert!(folder.join("lot.place.json").is_file());
}

/// Returns the texts of all elements with a given name.
fn texts(path: &Path, name: &str) -> Vec<String> {
    let mut reader = quick_xml::Reader::from_file(path).unwrap();
    let (mut found, mut inside, mut buffer) = (Vec::new(), false, Vec::new());
    loop {
        match reader.read_event_into(&mut buffer).unwrap() {
            Event::Start(element) => inside = element.name().as_ref() == name.as_bytes(),
            Event::Text(text) if inside => found.push(String::from_utf8(text.to_vec()).unwrap()),
            Event::End(_) => inside = false,
            Event::Eof => return found,
            _ => {}
        }
        buffer.clear();
    }
}

#[test]
fn kml_has_the_time_and_the_place_of_every_row() {
    let dir = tempfile::tempdir().unwrap();
    let folder = run_folder(dir.path(), false, true);
    rename_input(&folder, "clips/gate_2026-01-31_23-59-59.mp4");
    let mut run = Run::read(&folder).unwrap();
    run.put_on_map(&roadplane_geo::Site::Camera { at: [51.05, 13.74], bearing_deg: 130.0 }).unwrap();
    let file = export_to(&run, "kml", &dir.path().join("out")).join("lot.kml");
    let (times, places) = (texts(&file, "when"), texts(&file, "gx:coord"));
    let values = texts(&file, "gx:value");
    let rows: Vec<&TrackRow> = run.tracks.iter().flat_map(|track| &track.rows).collect();
    assert_eq!([times.len(), places.len(), values.len()], [rows.len(), rows.len(), 3 * rows.len()]);
    for ((row, time), place) in rows.iter().zip(&times).zip(&places) {
        let (minute, second) = match row.frame {
            0..10 => ("2026-01-31T23:59", 59 + row.frame / 10),
            _ => ("2026-02-01T00:00", row.frame / 10 - 1),
        };
        assert_eq!(*time, format!("{minute}:{second:02}.{:06}Z", row.frame % 10 * 100_000));
        let at: Vec<f64> = place.split(' ').map(|word| word.parse().unwrap()).collect();
        let told = row.on_map.as_ref().unwrap();
        close(at[0], told.longitude, 1e-9);
        close(at[1], told.latitude, 1e-9);
    }
    let speeds = &values[60..120];
    assert!(speeds.iter().all(|speed| speed == "8.0000"), "{speeds:?}");
    assert_eq!(texts(&file, "name"), ["lot", "car 1", "truck 2"]);
}

#[test]
fn kml_without_a_map_is_refused_with_the_remedy() {
    let dir = tempfile::tempdir().unwrap();
    let run = Run::read(&run_folder(dir.path(), false, true)).unwrap();
    let out = dir.path().join("out");
    let error = export(&run, &[Format::of("kml").unwrap()], &out, Existing::Refuse).unwrap_err();
    assert!(matches!(error, WriteError::Lacks { .. }));
    assert!(error.to_string().contains("the format kml needs a position on the map"), "{error}");
    assert!(error.to_string().contains("--camera-at"), "{error}");
    assert!(!out.exists());
}
