//! `tracks.parquet`: the rows of tracks as columns, for pandas, DuckDB and similar tools.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, ZstdLevel};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use roadplane_base::{OnMap, TrackRow};

use crate::digits::{not_finite, rounded_row};
use crate::{OutFile, WriteError};

/// Schema id of the rows. The metadata of the file contains this id under the key `schema`.
pub const TRACKS_SCHEMA: &str = "roadplane.tracks/1";

/// Number of rows per row group. The rows of a group, about 8 MB, stay in memory until they are compressed together.
const GROUP_ROWS: usize = 32_768;

const COLUMNS: &str = "
    required int64 frame; required double time_s; required int64 track;
    required double x_m; required double y_m; required double heading_rad; required double speed_mps;
    required double x_sd_m; required double y_sd_m; required double heading_sd_rad;
    required double length_m; required double width_m; required double height_m;
    required group bbox_px (LIST) { repeated group list { required double element; } }
    required double score; required boolean observed; optional binary activity (UTF8);
    required binary class (UTF8); required int64 segment;
    required double speed_sd_mps;
    optional double activity_p; optional double x_own_sd_m; optional double y_own_sd_m;
    optional double exists_p; optional double same_vehicle_p;
    required int64 ground; required double z_m;
";
/// Additional columns if the user gave the camera's position on the map.
const ON_MAP_COLUMNS: &str = "
    optional double latitude; optional double longitude; optional binary utm_zone (UTF8);
    optional double east_m; optional double north_m; optional double east_sd_m; optional double north_sd_m;
    optional double bearing_deg;
";

/// A last column `geometry` of a [`TrackParquet`], as GeoParquet defines it.
#[derive(Clone, Debug)]
pub struct GeometryColumn {
    /// Value of the key `geo` in the file's metadata: a JSON object that describes the column.
    pub geo: String,
    /// Returns the geometry of a row as well-known binary. The numbers of the row are rounded as in the file.
    pub of_row: fn(&TrackRow) -> Vec<u8>,
}

/// The file `tracks.parquet` in progress, compressed with zstd.
pub struct TrackParquet {
    writer: SerializedFileWriter<OutFile>,
    rows: Vec<TrackRow>,
    on_map: bool,
    geometry_of_row: Option<fn(&TrackRow) -> Vec<u8>>,
    path: std::path::PathBuf,
}

impl TrackParquet {
    /// Starts a file with the final name `path`. If `on_map` is true, the file also has columns for positions on the
    /// map.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn create(path: &Path, on_map: bool) -> Result<Self, WriteError> {
        Self::start(path, on_map, None)
    }

    /// Starts a file as [`TrackParquet::create`] does. The file also has a column with a geometry for each row.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn with_geometry(path: &Path, on_map: bool, geometry: GeometryColumn) -> Result<Self, WriteError> {
        Self::start(path, on_map, Some(geometry))
    }

    fn start(path: &Path, on_map: bool, geometry: Option<GeometryColumn>) -> Result<Self, WriteError> {
        let fail = WriteError::parquet(path);
        let more = if on_map { ON_MAP_COLUMNS } else { "" };
        let last = if geometry.is_some() { "required binary geometry;" } else { "" };
        let schema =
            parse_message_type(&format!("message tracks {{ {COLUMNS} {more} {last} }}")).map_err(&fail)?;
        let level = ZstdLevel::try_new(3).map_err(&fail)?;
        let mut notes = vec![KeyValue::new("schema".to_owned(), TRACKS_SCHEMA.to_owned())];
        notes.extend(geometry.as_ref().map(|column| KeyValue::new("geo".to_owned(), column.geo.clone())));
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(level))
            .set_created_by("roadplane".to_owned())
            .set_key_value_metadata(Some(notes))
            .build();
        let file = OutFile::create(path)?;
        let writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties)).map_err(fail)?;
        let geometry_of_row = geometry.map(|column| column.of_row);
        Ok(Self { writer, rows: Vec::new(), on_map, geometry_of_row, path: path.to_path_buf() })
    }

    /// Appends a row. Its numbers are rounded to a fixed number of decimals.
    ///
    /// # Errors
    /// [`WriteError::NotFinite`], [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn write(&mut self, row: &TrackRow) -> Result<(), WriteError> {
        if let Some(what) = not_finite(row) {
            return Err(WriteError::NotFinite { what: what.to_owned(), path: self.path.clone() });
        }
        self.rows.push(rounded_row(row));
        if self.rows.len() >= GROUP_ROWS { self.write_group() } else { Ok(()) }
    }

    /// Completes the file and gives it its final name.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`]. After an error, no file with the final name appears.
    pub fn finish(mut self) -> Result<(), WriteError> {
        if !self.rows.is_empty() {
            self.write_group()?;
        }
        self.writer.into_inner().map_err(WriteError::parquet(&self.path))?.finish()
    }

    fn write_group(&mut self) -> Result<(), WriteError> {
        let rows = std::mem::take(&mut self.rows);
        let fail = WriteError::parquet(&self.path);
        let mut group = self.writer.next_row_group().map_err(&fail)?;
        write_columns(&mut group, &rows)
            .and_then(|()| if self.on_map { write_on_map(&mut group, &rows) } else { Ok(()) })
            .and_then(|()| {
                self.geometry_of_row.map_or(Ok(()), |of_row| write_geometry(&mut group, &rows, of_row))
            })
            .and_then(|()| group.close().map(drop))
            .map_err(fail)
    }
}

fn write_columns(
    group: &mut SerializedRowGroupWriter<'_, OutFile>,
    rows: &[TrackRow],
) -> Result<(), ParquetError> {
    let integers =
        |of: fn(&TrackRow) -> u64| -> Vec<i64> { rows.iter().map(|r| of(r).cast_signed()).collect() };
    column::<Int64Type>(group, &integers(|r| r.frame), None)?;
    column::<DoubleType>(group, &doubles(rows, |r| r.time_s), None)?;
    column::<Int64Type>(group, &integers(|r| r.track), None)?;
    let numbers: [fn(&TrackRow) -> f64; 10] = [
        |r| r.x_m,
        |r| r.y_m,
        |r| r.heading_rad,
        |r| r.speed_mps,
        |r| r.x_sd_m,
        |r| r.y_sd_m,
        |r| r.heading_sd_rad,
        |r| r.length_m,
        |r| r.width_m,
        |r| r.height_m,
    ];
    for of in numbers {
        column::<DoubleType>(group, &doubles(rows, of), None)?;
    }
    let boxes: Vec<f64> = rows.iter().flat_map(|r| r.bbox_px).collect();
    // Repetition level 0 starts a new list; definition level 1 marks an element.
    let repetition: Vec<i16> = rows.iter().flat_map(|_| [0, 1, 1, 1]).collect();
    column::<DoubleType>(group, &boxes, Some((&vec![1; boxes.len()], Some(&repetition))))?;
    column::<DoubleType>(group, &doubles(rows, |r| r.score), None)?;
    column::<BoolType>(group, &rows.iter().map(|r| r.observed).collect::<Vec<_>>(), None)?;
    let defined: Vec<i16> = rows.iter().map(|r| i16::from(r.activity.is_some())).collect();
    let activities: Vec<ByteArray> =
        rows.iter().filter_map(|r| r.activity.as_deref().map(ByteArray::from)).collect();
    column::<ByteArrayType>(group, &activities, Some((&defined, None)))?;
    let classes: Vec<ByteArray> = rows.iter().map(|r| ByteArray::from(r.class.name())).collect();
    column::<ByteArrayType>(group, &classes, None)?;
    column::<Int64Type>(group, &integers(|r| r.segment as u64), None)?;
    column::<DoubleType>(group, &doubles(rows, |r| r.speed_sd_mps), None)?;
    let optional: [fn(&TrackRow) -> Option<f64>; 5] =
        [|r| r.activity_p, |r| r.x_own_sd_m, |r| r.y_own_sd_m, |r| r.exists_p, |r| r.same_vehicle_p];
    for of in optional {
        let defined: Vec<i16> = rows.iter().map(|r| i16::from(of(r).is_some())).collect();
        let values: Vec<f64> = rows.iter().filter_map(of).collect();
        column::<DoubleType>(group, &values, Some((&defined, None)))?;
    }
    column::<Int64Type>(group, &integers(|r| r.ground as u64), None)?;
    column::<DoubleType>(group, &doubles(rows, |r| r.z_m), None)?;
    Ok(())
}

fn write_on_map(
    group: &mut SerializedRowGroupWriter<'_, OutFile>,
    rows: &[TrackRow],
) -> Result<(), ParquetError> {
    let defined: Vec<i16> = rows.iter().map(|r| i16::from(r.on_map.is_some())).collect();
    let positions = || rows.iter().filter_map(|r| r.on_map.as_ref());
    let numbers = |group: &mut SerializedRowGroupWriter<'_, OutFile>, of: &[fn(&OnMap) -> f64]| {
        of.iter().try_for_each(|of| {
            column::<DoubleType>(group, &positions().map(of).collect::<Vec<_>>(), Some((&defined, None)))
        })
    };
    numbers(group, &[|at| at.latitude, |at| at.longitude])?;
    let zones: Vec<ByteArray> = positions().map(|at| ByteArray::from(at.utm_zone.as_str())).collect();
    column::<ByteArrayType>(group, &zones, Some((&defined, None)))?;
    let metres: [fn(&OnMap) -> f64; 4] =
        [|at| at.east_m, |at| at.north_m, |at| at.east_sd_m, |at| at.north_sd_m];
    numbers(group, &metres)?;
    numbers(group, &[|at| at.bearing_deg])
}

fn write_geometry(
    group: &mut SerializedRowGroupWriter<'_, OutFile>,
    rows: &[TrackRow],
    of_row: fn(&TrackRow) -> Vec<u8>,
) -> Result<(), ParquetError> {
    let geometries: Vec<ByteArray> = rows.iter().map(|row| ByteArray::from(of_row(row))).collect();
    column::<ByteArrayType>(group, &geometries, None)
}

fn doubles(rows: &[TrackRow], of: fn(&TrackRow) -> f64) -> Vec<f64> {
    rows.iter().map(of).collect()
}

/// Parquet levels of a column: the definition levels, and the repetition levels if the values are lists. `None` for a
/// column whose values are all present.
type Levels<'a> = Option<(&'a [i16], Option<&'a [i16]>)>;

fn column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, OutFile>,
    values: &[T::T],
    levels: Levels<'_>,
) -> Result<(), ParquetError> {
    let missing = || ParquetError::General("more columns than the schema has".to_owned());
    let mut column = group.next_column()?.ok_or_else(missing)?;
    let (definition, repetition) = levels.map_or((None, None), |(d, r)| (Some(d), r));
    column.typed::<T>().write_batch(values, definition, repetition)?;
    column.close()
}
