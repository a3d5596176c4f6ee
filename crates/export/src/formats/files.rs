//! Functions for files that several formats write.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use roadplane_base::TrackRow;
use roadplane_write::{OutFile, WriteError, write_json};

use crate::{Run, RunSegment, Track};

/// Returns the rows of a segment by frame. The rows of a frame are sorted by track number. Frames without rows are
/// missing.
pub(super) fn by_frame<'a>(
    run: &'a Run,
    segment: &RunSegment,
) -> BTreeMap<u64, Vec<(&'a Track, &'a TrackRow)>> {
    let mut by_frame: BTreeMap<u64, Vec<(&Track, &TrackRow)>> = BTreeMap::new();
    for (track, row) in run.rows().into_iter().filter(|(_, row)| segment.contains(row)) {
        by_frame.entry(row.frame).or_default().push((track, row));
    }
    by_frame
}

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
