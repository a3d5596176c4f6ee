//! Helpers of the end-to-end tests.

#![allow(dead_code, reason = "each test binary uses a part of this file")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use assert_cmd::Command;

/// Returns the command `roadplane`, which runs in the root of the repository.
pub fn roadplane() -> Command {
    program("roadplane")
}

/// Returns the command `roadplane-lab`, which runs in the root of the repository.
pub fn lab() -> Command {
    program("roadplane-lab")
}

fn program(name: &str) -> Command {
    let mut command = Command::cargo_bin(name).unwrap();
    command.current_dir(root()).env("ORT_DYLIB_PATH", root().join(".runtime/libonnxruntime.so"));
    command
}

/// Returns the program `roadplane` as a process, for tests with signals and limits.
pub fn process() -> std::process::Command {
    let mut command = std::process::Command::new(roadplane().get_program());
    command.current_dir(root()).env("ORT_DYLIB_PATH", root().join(".runtime/libonnxruntime.so"));
    command
}

/// Returns the root of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// Returns the path of a data file outside the repository. Tests that read such files are marked as ignored.
pub fn shared(path: &str) -> PathBuf {
    let path = root().join("../shared/data").join(path);
    assert!(path.exists(), "{} is absent", path.display());
    path
}

/// Reads a JSON file.
pub fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Returns a JSON value as a number.
pub fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().unwrap()
}

/// Reads the values of a JSON Lines file, one per line.
pub fn json_lines(path: &Path) -> Vec<serde_json::Value> {
    std::fs::read_to_string(path).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Returns the names of the files in a folder, sorted.
pub fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// Returns the data that the player of a report shows. The data does not depend on the time or the speed of the run.
pub fn played(report: &Path) -> String {
    let page = std::fs::read_to_string(report).unwrap();
    let (_, from) = page.split_once("id=\"player-data\">").unwrap();
    from.split_once("</script>").unwrap().0.to_owned()
}

/// Reads the first row of a CSV file, by column name. Cells that are not numbers become NaN.
pub fn first_row(path: &Path) -> BTreeMap<String, f64> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let row: BTreeMap<String, String> = reader.deserialize().next().unwrap().unwrap();
    row.into_iter().map(|(head, cell)| (head, cell.parse().unwrap_or(f64::NAN))).collect()
}
