//! Readers for file formats of other programs: reference cameras, KITTI, KPF, COCO and MOT Challenge. The error for a
//! malformed file names the file and the faulty line or field.

pub mod cameras;
pub mod coco;
pub mod kitti;
pub mod kpf;
pub mod mot;

use std::path::Path;
use std::str::FromStr;

use crate::MetricsError;
use crate::text_file::read_text;

/// Parses the field with this index in a line. `name` is the name of the field in error messages.
fn field<T: FromStr>(fields: &[&str], index: usize, name: &str) -> Result<T, String> {
    let text = fields.get(index).ok_or_else(|| format!("{name} is missing"))?;
    text.parse().ok().ok_or_else(|| format!("{name} {text:?} is not a valid value"))
}

/// Parses the field with this index in a line as a finite number. `name` is the name of the field in error messages.
fn number(fields: &[&str], index: usize, name: &str) -> Result<f64, String> {
    let value: f64 = field(fields, index, name)?;
    if value.is_finite() { Ok(value) } else { Err(format!("{name} is not finite")) }
}

/// Reads all lines that are not empty. `split` divides a line into fields, and `read` converts the fields to a value.
/// Errors name the line.
fn lines<T>(
    path: &Path,
    split: impl Fn(&str) -> Vec<&str>,
    read: impl Fn(&[&str]) -> Result<T, String>,
) -> Result<Vec<T>, MetricsError> {
    let text = read_text(path)?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let values = lines.map(|(i, line)| {
        read(&split(line)).map_err(|what| MetricsError::malformed(path, format!("line {}: {what}", i + 1)))
    });
    values.collect()
}
