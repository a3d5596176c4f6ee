//! Reading and writing of JSON files and JSON Lines files. A JSON Lines file has one JSON value per line.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use roadplane_base::PoseRecord;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::digits::rounded_pose;
use crate::{OutFile, WriteError};

/// Writes one value as an indented JSON file.
///
/// # Errors
/// [`WriteError::Io`], [`WriteError::DiskFull`]; [`WriteError::Malformed`] for a value that JSON cannot represent.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), WriteError> {
    let mut text = serde_json::to_vec_pretty(value).map_err(|e| WriteError::malformed(path, e))?;
    text.push(b'\n');
    let mut file = OutFile::create(path)?;
    file.write_bytes(&text)?;
    file.finish()
}

/// A JSON Lines file in progress, with one value per line.
#[derive(Debug)]
pub struct JsonLines {
    file: OutFile,
    line: Vec<u8>,
}

impl JsonLines {
    /// Starts a file with the final name `path`.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn create(path: &Path) -> Result<Self, WriteError> {
        Ok(Self { file: OutFile::create(path)?, line: Vec::new() })
    }

    /// Appends a value as one line.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`]; [`WriteError::Malformed`] for a value that JSON cannot represent.
    pub fn write<T: Serialize>(&mut self, value: &T) -> Result<(), WriteError> {
        json_line(&mut self.line, value, self.file.path())?;
        self.file.write_bytes(&self.line)
    }

    /// Completes the file and gives it its final name.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`]. After an error, no file with the final name appears.
    pub fn finish(self) -> Result<(), WriteError> {
        self.file.finish()
    }
}

/// Replaces the content of `line` by the JSON text of a value and a line end. Errors name `path`.
pub(crate) fn json_line<T: Serialize>(line: &mut Vec<u8>, value: &T, path: &Path) -> Result<(), WriteError> {
    line.clear();
    serde_json::to_writer(&mut *line, value).map_err(|e| WriteError::malformed(path, e))?;
    line.push(b'\n');
    Ok(())
}

/// The file `poses.jsonl` in progress, with one pose per line.
#[derive(Debug)]
pub struct PoseLines(JsonLines);

impl PoseLines {
    /// Starts a file with the final name `path`.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn create(path: &Path) -> Result<Self, WriteError> {
        JsonLines::create(path).map(Self)
    }

    /// Appends a pose. Its numbers are rounded to a fixed number of decimals.
    ///
    /// # Errors
    /// [`WriteError::NotFinite`] for a pose with a number that is not finite; [`WriteError::Io`],
    /// [`WriteError::DiskFull`].
    pub fn write(&mut self, pose: &PoseRecord) -> Result<(), WriteError> {
        let motions = pose.world_from_car.iter().chain(&pose.camera_from_car).flatten();
        if !motions.chain(&pose.shape).chain(&pose.dims_m).all(|v| v.is_finite()) {
            let what = format!("the pose of car {} in frame {}", pose.car, pose.frame);
            return Err(WriteError::NotFinite { what, path: self.0.file.path().to_path_buf() });
        }
        self.0.write(&rounded_pose(pose))
    }

    /// Completes the file and gives it its final name.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`]. After an error, no file with the final name appears.
    pub fn finish(self) -> Result<(), WriteError> {
        self.0.finish()
    }
}

/// Opens a JSON Lines file and returns an iterator over its values.
///
/// The iterator skips empty lines. If a line is invalid, the error contains the line number.
///
/// # Errors
/// [`WriteError::Io`] if the file cannot be opened.
pub fn read_jsonl<T: DeserializeOwned>(
    path: &Path,
) -> Result<impl Iterator<Item = Result<T, WriteError>> + use<T>, WriteError> {
    let file = File::open(path).map_err(WriteError::io("read", path))?;
    let path = path.to_path_buf();
    let lines = BufReader::new(file).lines().enumerate();
    Ok(lines.filter_map(move |(i, line)| match line {
        Err(error) => Some(Err(WriteError::io("read", &path)(error))),
        Ok(line) if line.trim().is_empty() => None,
        Ok(line) => Some(
            serde_json::from_str(&line)
                .map_err(|e| WriteError::malformed(&path, format!("line {}: {e}", i + 1))),
        ),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_back_and_errors_name_the_line() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.jsonl");
        let mut lines = JsonLines::create(&path).unwrap();
        for i in 0..3 {
            lines.write(&serde_json::json!({"i": i})).unwrap();
        }
        lines.finish().unwrap();
        let values: Vec<serde_json::Value> = read_jsonl(&path).unwrap().map(Result::unwrap).collect();
        assert_eq!(values.len(), 3);
        std::fs::write(&path, "{}\n\n{bad\n").unwrap();
        let results: Vec<Result<serde_json::Value, _>> = read_jsonl(&path).unwrap().collect();
        assert_eq!(results.len(), 2);
        let error = results[1].as_ref().unwrap_err().to_string();
        assert!(error.contains("line 3") && error.ends_with("x.jsonl"), "{error}");
        // Invalid UTF-8 is reported as a malformed file, not as an I/O error.
        std::fs::write(&path, b"{}\n\xff\xfe\n").unwrap();
        let results: Vec<Result<serde_json::Value, _>> = read_jsonl(&path).unwrap().collect();
        assert!(matches!(results[1], Err(WriteError::Malformed { .. })), "{:?}", results[1]);
    }
}
