//! Reads tracks from any table, one sample after the other.
//!
//! The table is a `tracks.*` of this program, a Parquet file of the nightly data set, or a table of another program. Only
//! time, track and position are required.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use parquet::column::reader::ColumnReader;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader as _, RowGroupReader, SerializedFileReader};
use roadplane_base::VehicleClass;

use crate::table::TableFormat;
use crate::{WriteError, read_jsonl};

/// A vehicle at one time, as a table describes it. Columns that the table lacks are `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrackSample {
    /// Time, s.
    pub time_s: f64,
    /// Number of the track.
    pub track: u64,
    /// Index of the camera segment, from 0.
    pub segment: usize,
    /// World position, m.
    pub position_m: [f64; 2],
    /// Heading, rad.
    pub heading_rad: Option<f64>,
    /// Speed along the heading, m/s.
    pub speed_mps: Option<f64>,
    /// Sds of the position, m.
    pub sd_m: Option<[f64; 2]>,
    /// Sds of the position without the error that all vehicles share, m.
    pub own_sd_m: Option<[f64; 2]>,
    /// Sd of the speed, m/s.
    pub speed_sd_mps: Option<f64>,
    /// Length and width of the vehicle, m.
    pub size_m: Option<[f64; 2]>,
    /// Class of the vehicle.
    pub class: Option<VehicleClass>,
    /// Easting and northing on the map, m.
    pub map_m: Option<[f64; 2]>,
    /// Local date and time of the sample, s since 1970-01-01 00:00 of the same clock.
    pub moment_s: Option<f64>,
}

/// Columns with numbers.
const NUMBERS: [&str; 19] = [
    "time_s",
    "track",
    "x_m",
    "y_m",
    "segment",
    "heading_rad",
    "speed_mps",
    "x_sd_m",
    "y_sd_m",
    "x_own_sd_m",
    "y_own_sd_m",
    "speed_sd_mps",
    "length_m",
    "width_m",
    "east_m",
    "north_m",
    "moment",
    "frame",
    "score",
];
/// Columns that every table must have. They are the first of [`NUMBERS`].
const REQUIRED: usize = 4;

/// Reads a table of tracks, and calls `each` for each sample in the order of the file.
///
/// # Errors
/// [`WriteError::Io`]; [`WriteError::Malformed`] if the table lacks a required column or has a value that is no number.
pub fn read_track_samples(path: &Path, mut each: impl FnMut(TrackSample)) -> Result<(), WriteError> {
    match TableFormat::of(path)? {
        TableFormat::Csv => read_csv(path, &mut each),
        TableFormat::Parquet => read_parquet(path, &mut each),
        TableFormat::Jsonl => read_lines(path, &mut each),
    }
}

/// The numbers of one row, by their place in [`NUMBERS`]; NaN where there is none.
type Numbers = [f64; NUMBERS.len()];

fn sample(numbers: &Numbers, class: Option<&str>) -> Option<TrackSample> {
    let number = |name: &str| {
        let value = numbers[NUMBERS.iter().position(|column| *column == name)?];
        value.is_finite().then_some(value)
    };
    let pair = |a: &str, b: &str| Some([number(a)?, number(b)?]);
    let named = |text: &str| VehicleClass::ALL.into_iter().find(|class| class.name() == text);
    let class = match class.filter(|text| !text.is_empty()) {
        Some(text) => Some(named(text)?),
        None => None,
    };
    Some(TrackSample {
        time_s: number("time_s")?,
        track: number("track").filter(|n| *n >= 0.0 && n.fract() == 0.0)? as u64,
        segment: number("segment").map_or(0, |n| n as usize),
        position_m: pair("x_m", "y_m")?,
        heading_rad: number("heading_rad"),
        speed_mps: number("speed_mps"),
        sd_m: pair("x_sd_m", "y_sd_m"),
        own_sd_m: pair("x_own_sd_m", "y_own_sd_m"),
        speed_sd_mps: number("speed_sd_mps"),
        size_m: pair("length_m", "width_m"),
        class,
        map_m: pair("east_m", "north_m"),
        moment_s: number("moment").map(|micros| micros / 1e6),
    })
}

fn check_columns(path: &Path, has: impl Fn(&str) -> bool) -> Result<(), WriteError> {
    let missing: Vec<&str> = NUMBERS[..REQUIRED].iter().copied().filter(|name| !has(name)).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let what = format!("no table of tracks: the columns {} are missing", missing.join(", "));
    Err(WriteError::malformed(path, what))
}

fn no_sample(path: &Path, row: usize) -> WriteError {
    let what = format!(
        "row {row}: time_s, x_m and y_m must be numbers, track a whole number, and class car, truck, bus or motorcycle"
    );
    WriteError::malformed(path, what)
}

fn read_csv(path: &Path, each: &mut impl FnMut(TrackSample)) -> Result<(), WriteError> {
    let fail = WriteError::csv("read", path);
    let mut reader = csv::Reader::from_path(path).map_err(&fail)?;
    let header = reader.headers().map_err(&fail)?.clone();
    let place = |name: &str| header.iter().position(|column| column.trim() == name);
    check_columns(path, |name| place(name).is_some())?;
    // A CSV file of the data set has its moments as text, not in microseconds.
    let places = NUMBERS.map(|name| place(name).filter(|_| name != "moment"));
    let class = place("class");
    let mut record = csv::StringRecord::new();
    let mut row = 1;
    while reader.read_record(&mut record).map_err(&fail)? {
        let field = |place: Option<usize>| record.get(place?).map(str::trim);
        let numbers = places.map(|place| field(place).and_then(|text| text.parse().ok()).unwrap_or(f64::NAN));
        each(sample(&numbers, field(class)).ok_or_else(|| no_sample(path, row))?);
        row += 1;
    }
    Ok(())
}

fn read_lines(path: &Path, each: &mut impl FnMut(TrackSample)) -> Result<(), WriteError> {
    for (row, line) in read_jsonl::<BTreeMap<String, serde_json::Value>>(path)?.enumerate() {
        let line = line?;
        let numbers = NUMBERS.map(|name| line.get(name).and_then(|v| v.as_f64()).unwrap_or(f64::NAN));
        let class = line.get("class").and_then(|v| v.as_str());
        each(sample(&numbers, class).ok_or_else(|| no_sample(path, row + 1))?);
    }
    Ok(())
}

fn read_parquet(path: &Path, each: &mut impl FnMut(TrackSample)) -> Result<(), WriteError> {
    let fail = |e: ParquetError| WriteError::malformed(path, e);
    let file = File::open(path).map_err(WriteError::io("read", path))?;
    let reader = SerializedFileReader::new(file).map_err(fail)?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let place = |name: &str| schema.columns().iter().position(|column| column.path().string() == name);
    check_columns(path, |name| place(name).is_some())?;
    let mut before = 0;
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group).map_err(fail)?;
        let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        let column = |name: &str| place(name).map(|i| Column::new(&*group, i)).transpose().map_err(fail);
        let mut columns = NUMBERS.iter().map(|name| column(name)).collect::<Result<Vec<_>, _>>()?;
        let mut class = column("class")?;
        for first in (0..rows).step_by(BLOCK_ROWS) {
            let block = BLOCK_ROWS.min(rows - first);
            let mut numbers: Vec<Option<Vec<f64>>> = Vec::new();
            for column in &mut columns {
                numbers.push(column.as_mut().map(|c| c.numbers(block)).transpose().map_err(fail)?);
            }
            let classes = class.as_mut().map(|column| column.texts(block)).transpose().map_err(fail)?;
            for row in 0..block {
                let at = |column: &Option<Vec<f64>>| column.as_ref().map_or(f64::NAN, |column| column[row]);
                let numbers: Numbers = std::array::from_fn(|i| at(&numbers[i]));
                let class = classes.as_ref().map(|classes| classes[row].as_str());
                each(sample(&numbers, class).ok_or_else(|| no_sample(path, before + first + row + 1))?);
            }
        }
        before += rows;
    }
    Ok(())
}

/// Number of rows that are in memory at a time. The row groups of other programs have a million rows.
const BLOCK_ROWS: usize = 16_384;

/// A column of a row group, read in blocks.
struct Column {
    reader: ColumnReader,
    is_optional: bool,
}

impl Column {
    fn new(group: &dyn RowGroupReader, column: usize) -> Result<Self, ParquetError> {
        let is_optional = group.metadata().column(column).column_descr().max_def_level() > 0;
        Ok(Self { reader: group.get_column_reader(column)?, is_optional })
    }

    /// Reads the next rows. Rows without a value are NaN, and so are all rows of a column with text.
    fn numbers(&mut self, rows: usize) -> Result<Vec<f64>, ParquetError> {
        let is_optional = self.is_optional;
        let mut defined: Vec<i16> = Vec::new();
        macro_rules! read {
            ($reader:expr, $number:expr) => {{
                let mut values = Vec::new();
                $reader.read_records(rows, is_optional.then_some(&mut defined), None, &mut values)?;
                values.into_iter().map($number).collect::<Vec<f64>>()
            }};
        }
        let values = match &mut self.reader {
            ColumnReader::DoubleColumnReader(reader) => read!(reader, |v: f64| v),
            ColumnReader::FloatColumnReader(reader) => read!(reader, f64::from),
            ColumnReader::Int64ColumnReader(reader) => read!(reader, |v: i64| v as f64),
            ColumnReader::Int32ColumnReader(reader) => read!(reader, f64::from),
            ColumnReader::BoolColumnReader(reader) => read!(reader, |v: bool| f64::from(u8::from(v))),
            _ => return Ok(vec![f64::NAN; rows]),
        };
        Ok(spread(values, &defined, is_optional, rows, f64::NAN))
    }

    /// Reads the next rows. Rows without a text are empty, and so are all rows of a column with numbers.
    fn texts(&mut self, rows: usize) -> Result<Vec<String>, ParquetError> {
        let mut defined: Vec<i16> = Vec::new();
        let ColumnReader::ByteArrayColumnReader(reader) = &mut self.reader else {
            return Ok(vec![String::new(); rows]);
        };
        let mut values = Vec::new();
        reader.read_records(rows, self.is_optional.then_some(&mut defined), None, &mut values)?;
        let texts = values.iter().map(|text| String::from_utf8_lossy(text.data()).into_owned()).collect();
        Ok(spread(texts, &defined, self.is_optional, rows, String::new()))
    }
}

/// Puts the values of an optional column into their rows.
fn spread<T: Clone>(values: Vec<T>, defined: &[i16], optional: bool, rows: usize, none: T) -> Vec<T> {
    let mut values = values.into_iter();
    let is_there = |row: usize| !optional || defined.get(row).is_some_and(|level| *level > 0);
    (0..rows)
        .map(|row| is_there(row).then(|| values.next()).flatten().unwrap_or_else(|| none.clone()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TrackFiles, write_table};
    use roadplane_base::TrackRow;

    fn row(frame: u64) -> TrackRow {
        let text = format!(
            r#"{{"frame":{frame},"time_s":{frame}.5,"track":3,"x_m":1.25,"y_m":20.5,"heading_rad":0.5,"speed_mps":7.0,
            "x_sd_m":0.5,"y_sd_m":1.5,"heading_sd_rad":0.1,"length_m":4.5,"width_m":1.75,"height_m":1.5,
            "bbox_px":[1.0,2.0,3.0,4.0],"score":0.5,"observed":true,"class":"bus","segment":1,"speed_sd_mps":0.25,
            "x_own_sd_m":0.125,"y_own_sd_m":0.25}}"#
        );
        serde_json::from_str(&text).unwrap()
    }

    #[test]
    fn the_three_files_of_a_run_give_the_same_samples() {
        let folder = tempfile::tempdir().unwrap();
        let mut files = TrackFiles::create(folder.path(), false).unwrap();
        (0..5).for_each(|frame| files.write(&row(frame)).unwrap());
        files.finish().unwrap();
        let read = |name: &str| {
            let mut samples = Vec::new();
            read_track_samples(&folder.path().join(name), |sample| samples.push(sample)).unwrap();
            samples
        };
        let samples = read("tracks.parquet");
        let expected = TrackSample {
            time_s: 4.5,
            track: 3,
            segment: 1,
            position_m: [1.25, 20.5],
            heading_rad: Some(0.5),
            speed_mps: Some(7.0),
            sd_m: Some([0.5, 1.5]),
            own_sd_m: Some([0.125, 0.25]),
            speed_sd_mps: Some(0.25),
            size_m: Some([4.5, 1.75]),
            class: Some(VehicleClass::Bus),
            ..TrackSample::default()
        };
        assert_eq!((samples.len(), samples[4]), (5, expected));
        assert_eq!((&read("tracks.csv"), &read("tracks.jsonl")), (&samples, &samples));
    }

    #[test]
    fn a_table_of_another_program_needs_four_columns() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.csv");
        std::fs::write(&path, "track,time_s,x_m,y_m,colour\n1,0.5,2,3,red\n").unwrap();
        let mut samples = Vec::new();
        read_track_samples(&path, |sample| samples.push(sample)).unwrap();
        let expected =
            TrackSample { time_s: 0.5, track: 1, position_m: [2.0, 3.0], ..TrackSample::default() };
        assert_eq!(samples, [expected]);
        for (text, fault) in [
            ("track,time_s,x\n1,0,2\n", "the columns x_m, y_m are missing"),
            ("track,time_s,x_m,y_m\n1,0,2,3\n1,b,2,3\n", "row 2"),
            ("track,time_s,x_m,y_m\n1.5,0,2,3\n", "row 1"),
        ] {
            std::fs::write(&path, text).unwrap();
            let error = read_track_samples(&path, |_| {}).unwrap_err().to_string();
            assert!(error.contains(fault), "{error}");
        }
        let lines = folder.path().join("other.parquet");
        let row = serde_json::json!({"time_s": 1, "track": 2, "x_m": 0.5, "y_m": null});
        write_table(&lines, &[row.as_object().unwrap().clone()]).unwrap();
        assert!(read_track_samples(&lines, |_| {}).is_err());
    }
}
