//! Figures → CSV, Parquet and JSON.

use std::path::Path;

use roadplane_traffic::Units;
use roadplane_write::{TableRow, WriteError, decimals, write_json, write_table};
use serde::Serialize;
use serde_json::Value;

use super::TrafficReport;

/// Decimals of the numbers in tables.
const DECIMALS: i32 = 4;

/// Writes `traffic.json`, and each table as CSV and Parquet. A table without rows is not written.
pub(super) fn write_all(report: &TrafficReport, folder: &Path) -> Result<(), WriteError> {
    let units = report.file.units;
    let mut whole = serde_json::to_value(&report.file).map_err(|e| WriteError::malformed(folder, e))?;
    tidy(&mut whole, units);
    write_json(&folder.join("traffic.json"), &whole)?;
    drop(whole);
    let figures = &report.file.figures;
    let write = |name: &str, rows: Result<Vec<TableRow>, serde_json::Error>| {
        let path = folder.join(format!("{name}.csv"));
        let rows = rows.map_err(|e| WriteError::malformed(&path, e))?;
        if rows.is_empty() {
            return Ok(());
        }
        write_table(&path, &rows)?;
        write_table(&path.with_extension("parquet"), &rows)
    };
    write("counts", rows(&figures.counts, units))?;
    write("speeds", rows(&figures.speeds, units))?;
    write("speed_histogram", rows(&figures.speed_histogram, units))?;
    write("headways", rows(&figures.headways, units))?;
    write("lanes", rows(&figures.lanes, units))?;
    write("flows", rows(&figures.flows, units))?;
    write("zones", rows(&figures.zones, units))?;
    write("conflicts", rows(&figures.conflicts, units))?;
    write("crossings", rows(&figures.crossings, units))?;
    write("stays", rows(&figures.stays, units))
}

fn rows<T: Serialize>(rows: &[T], units: Units) -> Result<Vec<TableRow>, serde_json::Error> {
    let row = |row: &T| {
        let mut value = serde_json::to_value(row)?;
        tidy(&mut value, units);
        Ok(match value {
            Value::Object(row) => row,
            _ => TableRow::new(),
        })
    };
    rows.iter().map(row).collect()
}

/// Rounds numbers, and converts speeds to the units.
fn tidy(value: &mut Value, units: Units) {
    match value {
        Value::Number(number) if number.is_f64() => {
            let rounded = number.as_f64().map_or(0.0, |number| decimals(number, DECIMALS));
            *value = rounded.into();
        }
        Value::Array(items) => items.iter_mut().for_each(|item| tidy(item, units)),
        Value::Object(row) => {
            if units == Units::Mph {
                *row = std::mem::take(row).into_iter().map(in_miles).collect();
            }
            row.values_mut().for_each(|item| tidy(item, units));
        }
        _ => {}
    }
}

fn in_miles((name, value): (String, Value)) -> (String, Value) {
    match (name.strip_suffix("_kmh"), value.as_f64()) {
        (Some(stem), Some(kmh)) => (format!("{stem}_mph"), Units::Mph.of_kmh(kmh).into()),
        (Some(stem), None) => (format!("{stem}_mph"), value),
        _ => (name, value),
    }
}
