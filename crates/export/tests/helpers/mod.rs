//! Functions that several tests use.

#![allow(dead_code, reason = "not every test uses every function")]

use std::path::{Path, PathBuf};

use roadplane_export::{Format, Run, Track, export};
use roadplane_geo::Site;
use roadplane_write::Existing;

use crate::fixture::run_folder;

/// Exports the fixture in one format. Returns the run and the folder of the format.
pub fn exported(name: &str, moved: bool) -> (Run, PathBuf, tempfile::TempDir) {
    let dir = tempfile::tempdir().unwrap();
    let run = Run::read(&run_folder(dir.path(), moved, true)).unwrap();
    let folder = export_to(&run, name, &dir.path().join("out"));
    (run, folder, dir)
}

/// Exports the fixture in one format, with a position of the camera on the map. Returns the run and the folder of the
/// format.
pub fn exported_on_map(name: &str) -> (Run, PathBuf, tempfile::TempDir) {
    let dir = tempfile::tempdir().unwrap();
    let mut run = Run::read(&run_folder(dir.path(), false, true)).unwrap();
    run.put_on_map(&Site::Camera { at: [51.05, 13.74], bearing_deg: 130.0 }).unwrap();
    let folder = export_to(&run, name, &dir.path().join("out"));
    (run, folder, dir)
}

/// Exports a run in one format, and returns the folder of the format.
pub fn export_to(run: &Run, name: &str, out: &Path) -> PathBuf {
    export(run, &[Format::of(name).unwrap()], out, Existing::Refuse).unwrap().remove(0)
}

/// Returns a track of a run.
pub fn track(run: &Run, id: u64) -> &Track {
    run.tracks.iter().find(|track| track.id == id).unwrap()
}

/// Checks that two numbers differ by at most `tolerance`.
pub fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} against {b}");
}

/// Gives the input of a result folder another name.
pub fn rename_input(folder: &Path, name: &str) {
    let summary = folder.join("summary.json");
    let text = std::fs::read_to_string(&summary).unwrap();
    std::fs::write(&summary, text.replace("clips/lot.mp4", name)).unwrap();
}
