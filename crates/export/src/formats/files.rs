//! Functions for files that several formats write.

use std::path::{Path, PathBuf};

use roadplane_write::{OutFile, WriteError, write_json};

use crate::Run;

/// Writes the camera's position on the map to `NAME.place.json`. If the run has no position on the map, nothing is
/// written.
pub(super) fn write_place(run: &Run, folder: &Path) -> Result<(), WriteError> {
    let Some(place) = &run.place else { return Ok(()) };
    write_json(&folder.join(format!("{}.place.json", run.name)), place)
}

/// Writes a text file.
pub(super) fn write_text(path: &Path, text: &str) -> Result<(), WriteError> {
    let mut file = OutFile::create(path)?;
    file.write_bytes(text.as_bytes())?;
    file.finish()
}

/// Creates the subfolder `name` in the folder of a format, and returns the subfolder's path.
pub(super) fn subfolder(folder: &Path, name: &str) -> Result<PathBuf, WriteError> {
    let path = folder.join(name);
    let failed = |source| WriteError::Io { doing: "create the folder", source, path: path.clone() };
    std::fs::create_dir_all(&path).map_err(failed)?;
    Ok(path)
}
