//! Tables with arbitrary columns, in CSV, JSON Lines or Parquet.
//!
//! A program can read a table, add columns and write the table again. The other columns do not change.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, ZstdLevel};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::record::Field;
use parquet::schema::parser::parse_message_type;
use serde_json::{Map, Value};

use crate::{JsonLines, OutFile, WriteError, read_jsonl};

/// A row of a table: its values by column name. The columns are in the order of the file.
pub type TableRow = Map<String, Value>;

/// Number of rows per row group of a Parquet file.
const GROUP_ROWS: usize = 32_768;

/// The format of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableFormat {
    /// Comma-separated values with a header.
    Csv,
    /// JSON Lines: one object per line.
    Jsonl,
    /// Parquet, compressed with zstd.
    Parquet,
}

impl TableFormat {
    /// Returns the format that belongs to the extension of a file name.
    ///
    /// # Errors
    /// [`WriteError::Malformed`] for an unknown extension.
    pub fn of(path: &Path) -> Result<Self, WriteError> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("csv") => Ok(Self::Csv),
            Some("jsonl") => Ok(Self::Jsonl),
            Some("parquet") => Ok(Self::Parquet),
            _ => Err(WriteError::malformed(path, "the file name must end in .csv, .jsonl or .parquet")),
        }
    }
}

/// Reads all rows of a table.
///
/// Numeric fields of a CSV file become numbers, `true` and `false` become booleans, and empty fields become null.
///
/// # Errors
/// [`WriteError::Io`]; [`WriteError::Malformed`], which names the line.
pub fn read_table(path: &Path) -> Result<Vec<TableRow>, WriteError> {
    match TableFormat::of(path)? {
        TableFormat::Csv => read_csv(path),
        TableFormat::Jsonl => read_jsonl(path)?.collect(),
        TableFormat::Parquet => read_parquet(path),
    }
}

/// Writes rows as a table. The table has every column that occurs in any row, in the order of first occurrence.
///
/// # Errors
/// [`WriteError::Io`], [`WriteError::DiskFull`]; [`WriteError::Malformed`] for columns that the format cannot
/// represent. After an error, no file with the final name appears.
pub fn write_table(path: &Path, rows: &[TableRow]) -> Result<(), WriteError> {
    match TableFormat::of(path)? {
        TableFormat::Csv => write_csv(path, rows),
        TableFormat::Jsonl => {
            let mut lines = JsonLines::create(path)?;
            rows.iter().try_for_each(|row| lines.write(row))?;
            lines.finish()
        }
        TableFormat::Parquet => write_parquet(path, rows),
    }
}

fn columns(rows: &[TableRow]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for row in rows {
        // This check saves time, because nearly all rows have the same columns.
        if row.len() != names.len() || row.keys().zip(&names).any(|(a, b)| a != b) {
            for name in row.keys() {
                if !names.contains(&name.as_str()) {
                    names.push(name);
                }
            }
        }
    }
    names
}

fn read_csv(path: &Path) -> Result<Vec<TableRow>, WriteError> {
    let fail = WriteError::csv("read", path);
    let mut reader = csv::Reader::from_path(path).map_err(&fail)?;
    let names: Vec<String> = reader.headers().map_err(&fail)?.iter().map(str::to_owned).collect();
    let row = |record: Result<csv::StringRecord, csv::Error>| {
        Ok(names.iter().cloned().zip(record.map_err(&fail)?.iter().map(csv_value)).collect())
    };
    reader.records().map(row).collect()
}

fn csv_value(text: &str) -> Value {
    match text {
        "" => Value::Null,
        "true" | "True" | "TRUE" => Value::Bool(true),
        "false" | "False" | "FALSE" => Value::Bool(false),
        _ => match (text.parse::<i64>(), text.parse::<f64>()) {
            // Other digits, such as those of 007, are text.
            (Ok(whole), _) if whole.to_string() == text => whole.into(),
            (Err(_), Ok(number)) if number.is_finite() => number.into(),
            _ => text.into(),
        },
    }
}

fn write_csv(path: &Path, rows: &[TableRow]) -> Result<(), WriteError> {
    let names = columns(rows);
    let fail = WriteError::csv("write", path);
    let mut writer = csv::Writer::from_writer(OutFile::create(path)?);
    writer.write_record(&names).map_err(&fail)?;
    for row in rows {
        let text = |name: &&str| match row.get(*name) {
            None | Some(Value::Null) => String::new(),
            Some(Value::String(text)) => text.clone(),
            Some(value) => value.to_string(),
        };
        writer.write_record(names.iter().map(text)).map_err(&fail)?;
    }
    writer.into_inner().map_err(|e| WriteError::io("write", path)(e.into_error()))?.finish()
}

fn read_parquet(path: &Path) -> Result<Vec<TableRow>, WriteError> {
    let fail = |e: ParquetError| WriteError::malformed(path, e);
    let file = File::open(path).map_err(WriteError::io("read", path))?;
    let reader = SerializedFileReader::new(file).map_err(fail)?;
    let rows = reader.get_row_iter(None).map_err(fail)?;
    let row = |row: Result<parquet::record::Row, ParquetError>| {
        let row = row.map_err(fail)?;
        Ok(row.get_column_iter().map(|(name, field)| (name.clone(), field_value(field))).collect())
    };
    rows.map(row).collect()
}

/// Converts a field of a Parquet file to JSON. A type that JSON does not have becomes text.
fn field_value(field: &Field) -> Value {
    match field {
        Field::Null => Value::Null,
        Field::Bool(value) => (*value).into(),
        Field::Byte(value) => (*value).into(),
        Field::Short(value) => (*value).into(),
        Field::Int(value) => (*value).into(),
        Field::Long(value) => (*value).into(),
        Field::UByte(value) => (*value).into(),
        Field::UShort(value) => (*value).into(),
        Field::UInt(value) => (*value).into(),
        Field::ULong(value) => (*value).into(),
        Field::Float(value) => (*value).into(),
        Field::Double(value) => (*value).into(),
        Field::Str(value) => value.as_str().into(),
        Field::ListInternal(list) => list.elements().iter().map(field_value).collect(),
        Field::Group(row) => {
            row.get_column_iter().map(|(n, f)| (n.clone(), field_value(f))).collect::<Map<_, _>>().into()
        }
        other => other.to_string().into(),
    }
}

/// The type of a Parquet column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Bool,
    Whole,
    Number,
    Numbers,
    Text,
}

impl Kind {
    /// Returns the narrowest column type that fits all values. Null fits every type.
    fn of<'a>(values: impl Iterator<Item = &'a Value> + Clone) -> Self {
        let all = |fits: fn(&Value) -> bool| values.clone().filter(|value| !value.is_null()).all(fits);
        let numbers = |v: &Value| v.as_array().is_some_and(|list| list.iter().all(Value::is_number));
        if values.clone().all(Value::is_null) {
            Self::Text
        } else if all(Value::is_boolean) {
            Self::Bool
        } else if all(Value::is_i64) {
            Self::Whole
        } else if all(Value::is_number) {
            Self::Number
        } else if all(numbers) {
            Self::Numbers
        } else {
            Self::Text
        }
    }

    fn declared(self, name: &str) -> String {
        match self {
            Self::Bool => format!("optional boolean {name};"),
            Self::Whole => format!("optional int64 {name};"),
            Self::Number => format!("optional double {name};"),
            Self::Numbers => format!(
                "optional group {name} (LIST) {{ repeated group list {{ required double element; }} }}"
            ),
            Self::Text => format!("optional binary {name} (UTF8);"),
        }
    }
}

fn write_parquet(path: &Path, rows: &[TableRow]) -> Result<(), WriteError> {
    let names = columns(rows);
    if let Some(odd) = names
        .iter()
        .find(|name| name.is_empty() || name.contains(|c: char| c.is_whitespace() || "(){};=,".contains(c)))
    {
        return Err(WriteError::malformed(path, format!("Parquet does not allow the column name {odd:?}")));
    }
    let fail = |e: ParquetError| WriteError::malformed(path, e);
    let kinds: Vec<Kind> =
        names.iter().map(|name| Kind::of(rows.iter().filter_map(|row| row.get(*name)))).collect();
    let fields: String = names.iter().zip(&kinds).map(|(name, kind)| kind.declared(name)).collect();
    let schema = parse_message_type(&format!("message table {{ {fields} }}")).map_err(fail)?;
    let level = ZstdLevel::try_new(3).map_err(fail)?;
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(level))
        .set_created_by("roadplane".to_owned())
        .build();
    let mut writer =
        SerializedFileWriter::new(OutFile::create(path)?, Arc::new(schema), Arc::new(properties))
            .map_err(fail)?;
    for rows in rows.chunks(GROUP_ROWS) {
        let mut group = writer.next_row_group().map_err(fail)?;
        for (name, kind) in names.iter().zip(&kinds) {
            write_column(&mut group, rows, name, *kind).map_err(fail)?;
        }
        group.close().map_err(fail)?;
    }
    writer.into_inner().map_err(fail)?.finish()
}

fn write_column(
    group: &mut SerializedRowGroupWriter<'_, OutFile>,
    rows: &[TableRow],
    name: &str,
    kind: Kind,
) -> Result<(), ParquetError> {
    let Some(mut column) = group.next_column()? else {
        return Err(ParquetError::General("more columns than the schema has".to_owned()));
    };
    let cells: Vec<Option<&Value>> =
        rows.iter().map(|row| row.get(name).filter(|value| !value.is_null())).collect();
    let there = || cells.iter().copied().flatten();
    let defined: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
    match kind {
        Kind::Bool => {
            let values: Vec<bool> = there().filter_map(Value::as_bool).collect();
            column.typed::<BoolType>().write_batch(&values, Some(&defined), None)?;
        }
        Kind::Whole => {
            let values: Vec<i64> = there().filter_map(Value::as_i64).collect();
            column.typed::<Int64Type>().write_batch(&values, Some(&defined), None)?;
        }
        Kind::Number => {
            let values: Vec<f64> = there().filter_map(Value::as_f64).collect();
            column.typed::<DoubleType>().write_batch(&values, Some(&defined), None)?;
        }
        Kind::Numbers => {
            // Definition level: 0 for no list, 1 for an empty list, 2 for an element. Repetition level: 0 starts a row.
            let (mut values, mut definition, mut repetition) = (Vec::new(), Vec::new(), Vec::new());
            for cell in &cells {
                let list = cell.and_then(Value::as_array);
                let numbers: Vec<f64> = list.into_iter().flatten().filter_map(Value::as_f64).collect();
                if numbers.is_empty() {
                    definition.push(i16::from(list.is_some()));
                    repetition.push(0);
                }
                definition.extend(numbers.iter().map(|_| 2));
                repetition.extend((0..numbers.len()).map(|i| i16::from(i > 0)));
                values.extend(numbers);
            }
            column.typed::<DoubleType>().write_batch(&values, Some(&definition), Some(&repetition))?;
        }
        Kind::Text => {
            let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            let values: Vec<ByteArray> =
                there().map(|value| ByteArray::from(text(value).into_bytes())).collect();
            column.typed::<ByteArrayType>().write_batch(&values, Some(&defined), None)?;
        }
    }
    column.close()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn texts_of_csv_files_stay_as_they_are() {
        let values = ["007", "7", "-2", "1.5", "True", "FALSE", "", "+3"].map(csv_value);
        assert_eq!(json!(values), json!(["007", 7, -2, 1.5, true, false, null, "+3"]));
    }

    fn rows() -> Vec<TableRow> {
        [
            json!({"time_s": 0.0, "track": 1, "x_m": 1.5, "seen": true, "box": [1.0, 2.0], "note": "a, \"b\""}),
            json!({"time_s": 0.5, "track": 2, "x_m": -2.5, "seen": false, "box": null, "note": null}),
            json!({"time_s": 1.5, "track": 2, "x_m": 2.25, "seen": false, "box": [], "note": "x", "more": 7}),
        ]
        .iter()
        .filter_map(|row| row.as_object().cloned())
        .collect()
    }

    #[test]
    fn tables_are_read_back_unchanged_in_every_format() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["t.csv", "t.jsonl", "t.parquet"] {
            let path = folder.path().join(name);
            write_table(&path, &rows()).unwrap();
            let read = read_table(&path).unwrap();
            for (row, before) in read.iter().zip(rows()) {
                for key in ["time_s", "track", "x_m", "seen", "note"] {
                    assert_eq!(row[key].as_f64(), before[key].as_f64(), "{name} {key}");
                    assert_eq!(row[key].as_str(), before[key].as_str(), "{name} {key}");
                    assert_eq!(row[key].as_bool(), before[key].as_bool(), "{name} {key}");
                }
                if name != "t.csv" {
                    assert_eq!(row["box"], before["box"], "{name}");
                }
            }
            assert_eq!(read[2]["more"], 7, "{name}");
            assert_eq!(read.len(), 3);
        }
    }

    #[test]
    fn broken_tables_are_named() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["t.parquet", "t.jsonl"] {
            let path = folder.path().join(name);
            std::fs::write(&path, "no table").unwrap();
            assert!(read_table(&path).unwrap_err().to_string().contains(name));
        }
        assert!(read_table(Path::new("t.xml")).is_err());
    }
}
