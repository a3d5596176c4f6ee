//! GeoParquet 1.1: tracks as lines, and rows as points. The geometries are well-known binary.
//!
//! If the run has a position on the map, the coordinates are longitude and latitude (`OGC:CRS84`, the reference system
//! that GeoParquet has by default). Otherwise they are metres from the point on the ground below the camera, and the
//! reference system is null.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use roadplane_base::TrackRow;
use roadplane_write::{GeometryColumn, OutFile, TrackParquet, WriteError};
use serde_json::{Value, json};

use super::files::write_place;
use crate::{Run, RunSegment, Track};

const TRACK_COLUMNS: &str = "
    required int64 track; required binary class (UTF8); required double length_m; required double width_m;
    required double height_m; required int64 rows; required int64 from_frame; required int64 to_frame;
    required double from_s; required double to_s; required binary geometry;
";

/// Writes two files per segment: one file with a line for each track, and one file with a point for each row. The
/// columns of the rows are those of `tracks.parquet`.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for segment in &run.segments {
        let file = |kind: &str| folder.join(format!("{}.{kind}.parquet", segment.name));
        write_tracks(run, segment, &file("tracks"))?;
        let column = GeometryColumn { geo: metadata(run, segment, "Point"), of_row: point };
        let mut rows = TrackParquet::with_geometry(&file("rows"), run.place.is_some(), column)?;
        for (_, row) in run.rows().into_iter().filter(|(_, row)| segment.contains(row)) {
            rows.write(row)?;
        }
        rows.finish()?;
    }
    write_place(run, folder)
}

/// Returns the position of a row: longitude and latitude, degrees, or x and y, m.
fn position(row: &TrackRow) -> [f64; 2] {
    row.on_map.as_ref().map_or([row.x_m, row.y_m], |at| [at.longitude, at.latitude])
}

/// Returns a point as well-known binary: byte order, type, coordinates.
fn point(row: &TrackRow) -> Vec<u8> {
    let mut bytes = vec![1, 1, 0, 0, 0];
    bytes.extend(position(row).into_iter().flat_map(f64::to_le_bytes));
    bytes
}

/// Returns a line as well-known binary: byte order, type, number of points, coordinates. A single row gives a line with
/// two equal ends.
fn line(rows: &[&TrackRow]) -> Vec<u8> {
    let mut path: Vec<[f64; 2]> = rows.iter().map(|row| position(row)).collect();
    if let [only] = path[..] {
        path.push(only);
    }
    let mut bytes = vec![1, 2, 0, 0, 0];
    bytes.extend(u32::try_from(path.len()).unwrap_or(u32::MAX).to_le_bytes());
    bytes.extend(path.into_iter().flatten().flat_map(f64::to_le_bytes));
    bytes
}

/// Returns the value of the key `geo` in the file's metadata.
fn metadata(run: &Run, segment: &RunSegment, kind: &str) -> String {
    let mut column = json!({"encoding": "WKB", "geometry_types": [kind]});
    let rows = run.rows().into_iter().filter(|(_, row)| segment.contains(row));
    let bounds =
        rows.map(|(_, row)| position(row)).fold(None, |bounds: Option<[f64; 4]>, [x, y]| match bounds {
            None => Some([x, y, x, y]),
            Some([x0, y0, x1, y1]) => Some([x.min(x0), y.min(y0), x.max(x1), y.max(y1)]),
        });
    if let Some(bounds) = bounds {
        column["bbox"] = json!(bounds);
    }
    if run.place.is_none() {
        column["crs"] = Value::Null;
    }
    json!({"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}).to_string()
}

fn write_tracks(run: &Run, segment: &RunSegment, path: &Path) -> Result<(), WriteError> {
    let fail = WriteError::parquet(path);
    let schema = parse_message_type(&format!("message tracks {{ {TRACK_COLUMNS} }}")).map_err(&fail)?;
    let geo = KeyValue::new("geo".to_owned(), metadata(run, segment, "LineString"));
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(3).map_err(&fail)?))
        .set_created_by("roadplane".to_owned())
        .set_key_value_metadata(Some(vec![geo]))
        .build();
    let file = OutFile::create(path)?;
    let mut writer =
        SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties)).map_err(&fail)?;
    let paths: Vec<(&Track, Vec<&TrackRow>)> = run
        .tracks
        .iter()
        .map(|track| (track, track.rows.iter().filter(|row| segment.contains(row)).collect::<Vec<_>>()))
        .filter(|(_, rows)| !rows.is_empty())
        .collect();
    if !paths.is_empty() {
        let mut group = writer.next_row_group().map_err(&fail)?;
        write_columns(&mut group, &paths).and_then(|()| group.close().map(drop)).map_err(&fail)?;
    }
    writer.into_inner().map_err(&fail)?.finish()
}

fn write_columns(
    group: &mut SerializedRowGroupWriter<'_, OutFile>,
    paths: &[(&Track, Vec<&TrackRow>)],
) -> Result<(), ParquetError> {
    let whole = |value: u64| value.cast_signed();
    let ends = || paths.iter().filter_map(|(_, rows)| Some((*rows.first()?, *rows.last()?)));
    let bytes = |text: &str| ByteArray::from(text);
    column::<Int64Type>(group, paths.iter().map(|(track, _)| whole(track.id)))?;
    column::<ByteArrayType>(group, paths.iter().map(|(track, _)| bytes(track.class.name())))?;
    column::<DoubleType>(group, ends().map(|(first, _)| first.length_m))?;
    column::<DoubleType>(group, ends().map(|(first, _)| first.width_m))?;
    column::<DoubleType>(group, ends().map(|(first, _)| first.height_m))?;
    column::<Int64Type>(group, paths.iter().map(|(_, rows)| whole(rows.len() as u64)))?;
    column::<Int64Type>(group, ends().map(|(first, _)| whole(first.frame)))?;
    column::<Int64Type>(group, ends().map(|(_, last)| whole(last.frame)))?;
    column::<DoubleType>(group, ends().map(|(first, _)| first.time_s))?;
    column::<DoubleType>(group, ends().map(|(_, last)| last.time_s))?;
    column::<ByteArrayType>(group, paths.iter().map(|(_, rows)| ByteArray::from(line(rows))))
}

fn column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, OutFile>,
    values: impl Iterator<Item = T::T>,
) -> Result<(), ParquetError> {
    let missing = || ParquetError::General("more columns than the schema has".to_owned());
    let mut column = group.next_column()?.ok_or_else(missing)?;
    column.typed::<T>().write_batch(&values.collect::<Vec<_>>(), None, None)?;
    column.close()
}
