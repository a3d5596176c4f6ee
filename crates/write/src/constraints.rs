//! Lengths on the ground that the user gives as constraints, in a JSON file or a CSV table.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::WriteError;

/// Schema id of a JSON file with lengths for the option `--known`.
pub const CONSTRAINTS_SCHEMA: &str = "roadplane.known/1";
/// Columns of a CSV file. The columns in brackets are optional.
const COLUMNS: &str = "x1,y1,x2,y2,length_m,sd_m[,pixel_sd][,frame][,name]";

/// Lengths on the ground that the user gives with the option `--known`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "known: lengths for --known, one object per file")]
#[serde(deny_unknown_fields)]
pub struct ConstraintsFile {
    /// Id of the schema: `roadplane.known/1`.
    #[schemars(extend("const" = CONSTRAINTS_SCHEMA))]
    pub schema: String,
    /// Lengths on the ground. The list must not be empty.
    pub lengths: Vec<LengthConstraint>,
}

/// The distance between two points on the ground, such as the width of a parking bay or a lane. Both points are visible
/// in the picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LengthConstraint {
    /// Position of the first point in the picture, px: x to the right, y down. The position (0, 0) is the centre of the
    /// top left pixel.
    pub from_px: [f64; 2],
    /// Position of the second point in the picture, px: x to the right, y down.
    pub to_px: [f64; 2],
    /// Length on the ground, m.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub length_m: f64,
    /// Standard deviation of `length_m`, m. It must be less than `length_m`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub sd_m: f64,
    /// Standard deviation of each pixel coordinate in `from_px` and `to_px`, px.
    #[schemars(extend("exclusiveMinimum" = 0))]
    #[serde(default = "one_pixel")]
    pub pixel_sd: f64,
    /// Index of the frame that has the two points, from 0, if the camera moves. Without a frame, the points lie in the
    /// camera's first picture.
    #[serde(default)]
    pub frame: Option<u64>,
    /// Name of the length in messages. Without a name, messages contain the number of the length or of its line.
    #[serde(default)]
    pub name: Option<String>,
}

fn one_pixel() -> f64 {
    1.0
}

/// A line of a CSV file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    x1: f64,
    y1: f64,
    x2: f64,
    y2: f64,
    length_m: f64,
    sd_m: f64,
    pixel_sd: Option<f64>,
    frame: Option<u64>,
    name: Option<String>,
}

/// Reads lengths from a CSV table if the file name ends in `.csv`, and from JSON otherwise.
///
/// A length without a name is named after its line (CSV) or its number in the list (JSON).
///
/// # Errors
/// [`WriteError::Io`]; [`WriteError::Malformed`], which names the line or the field.
pub fn read_constraints(path: &Path) -> Result<Vec<LengthConstraint>, WriteError> {
    let bytes = std::fs::read(path).map_err(WriteError::io("read", path))?;
    let is_table = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"));
    let lengths = if is_table { table(path, &bytes)? } else { json(path, &bytes)? };
    if lengths.is_empty() {
        return Err(WriteError::malformed(path, "contains no length"));
    }
    for length in &lengths {
        check(length).map_err(|what| {
            WriteError::malformed(path, format!("{}: {what}", length.name.as_deref().unwrap_or_default()))
        })?;
    }
    Ok(lengths)
}

fn table(path: &Path, bytes: &[u8]) -> Result<Vec<LengthConstraint>, WriteError> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(bytes);
    let columns = reader.headers().map_err(|e| WriteError::malformed(path, e))?.clone();
    let mut lengths = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| WriteError::malformed(path, e))?;
        let number = record.position().map_or(0, csv::Position::line);
        let line: Line = record.deserialize(Some(&columns)).map_err(|e| {
            WriteError::malformed(
                path,
                format!("line {number} must have the columns {COLUMNS}, which the first line names: {e}"),
            )
        })?;
        lengths.push(LengthConstraint {
            from_px: [line.x1, line.y1],
            to_px: [line.x2, line.y2],
            length_m: line.length_m,
            sd_m: line.sd_m,
            pixel_sd: line.pixel_sd.unwrap_or_else(one_pixel),
            frame: line.frame,
            name: Some(line.name.filter(|name| !name.is_empty()).unwrap_or_else(|| format!("line {number}"))),
        });
    }
    Ok(lengths)
}

fn json(path: &Path, bytes: &[u8]) -> Result<Vec<LengthConstraint>, WriteError> {
    let file: ConstraintsFile = serde_json::from_slice(bytes).map_err(|e| WriteError::malformed(path, e))?;
    if file.schema != CONSTRAINTS_SCHEMA {
        let what = format!("the schema is {:?}, expected {CONSTRAINTS_SCHEMA:?}", file.schema);
        return Err(WriteError::malformed(path, what));
    }
    let named = |(i, length): (usize, LengthConstraint)| {
        let name = length.name.clone().unwrap_or_else(|| format!("length {}", i + 1));
        LengthConstraint { name: Some(name), ..length }
    };
    Ok(file.lengths.into_iter().enumerate().map(named).collect())
}

fn check(length: &LengthConstraint) -> Result<(), String> {
    let positive = |what: &str, value: f64| {
        (value.is_finite() && value > 0.0)
            .then_some(())
            .ok_or_else(|| format!("{what} must be above 0, but it is {value}"))
    };
    positive("length_m", length.length_m)?;
    positive("sd_m", length.sd_m)?;
    positive("pixel_sd", length.pixel_sd)?;
    if length.sd_m >= length.length_m {
        return Err("sd_m must be less than length_m: both are in metres".to_owned());
    }
    if !length.from_px.iter().chain(&length.to_px).all(|v| v.is_finite()) {
        return Err("a pixel coordinate is not finite".to_owned());
    }
    let apart_px = (length.from_px[0] - length.to_px[0]).hypot(length.from_px[1] - length.to_px[1]);
    if apart_px < 1.0 {
        return Err("both ends are at the same pixel".to_owned());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, text: &str) -> Result<Vec<LengthConstraint>, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        read_constraints(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn a_table_and_json_give_the_same_lengths() {
        let table = "# bays of the back row\nx1,y1,x2,y2,length_m,sd_m,pixel_sd,frame,name\n\
                     100, 500, 180.5, 502, 2.5, 0.03, 0.5, 75, bay\n1,2,30,4,5,0.1,,,\n";
        let json = r#"{"schema": "roadplane.known/1", "lengths": [
            {"from_px": [100, 500], "to_px": [180.5, 502], "length_m": 2.5, "sd_m": 0.03, "pixel_sd": 0.5,
             "frame": 75, "name": "bay"},
            {"from_px": [1, 2], "to_px": [30, 4], "length_m": 5, "sd_m": 0.1, "name": "line 4"}]}"#;
        let lengths = read("a.csv", table).unwrap();
        assert_eq!(lengths, read("a.json", json).unwrap());
        assert_eq!((lengths[1].pixel_sd, lengths[1].name.as_deref()), (1.0, Some("line 4")));
        assert_eq!((lengths[0].frame, lengths[1].frame), (Some(75), None));
        assert!(read("b.CSV", "x1,y1,x2,y2,length_m,sd_m\n1,2,30,4,5,0.1").is_ok());
    }

    #[test]
    fn an_invalid_length_is_rejected_with_its_line() {
        for (name, text, words) in [
            (
                "a.csv",
                "x1,y1,x2,y2,length_m\n1,2,30,4,5",
                "line 2 must have the columns x1,y1,x2,y2,length_m,sd_m",
            ),
            ("a.csv", "x1,y1,x2,y2,length_m,sd_m\n1,2,30,4,5,wide", "line 2"),
            ("a.csv", "x1,y1,x2,y2,length_m,sd_cm\n1,2,30,4,5,3", "line 2"),
            (
                "a.csv",
                "x1,y1,x2,y2,length_m,sd_m\n1,2,30,4,5,0.1\n1,2,30,4,-5,0.1",
                "line 3: length_m must be above 0",
            ),
            ("a.csv", "x1,y1,x2,y2,length_m,sd_m\n1,2,30,4,5,NaN", "sd_m must be above 0"),
            ("a.csv", "x1,y1,x2,y2,length_m,sd_m\n1,2,30,4,2.5,5", "both are in metres"),
            ("a.csv", "x1,y1,x2,y2,length_m,sd_m\n1,2,1,2,5,0.1", "the same pixel"),
            ("a.csv", "x1,y1,x2,y2,length_m,sd_m\n", "contains no length"),
            ("a.json", r#"{"schema": "other/1", "lengths": []}"#, "roadplane.known/1"),
            ("a.json", r#"{"schema": "roadplane.known/1", "lengths": [{"from_px": [1, 2]}]}"#, "to_px"),
            ("a.json", "x1,y1", "expected value"),
        ] {
            let error = read(name, text).unwrap_err();
            assert!(error.contains(words) && error.ends_with(name), "{error}");
        }
    }
}
