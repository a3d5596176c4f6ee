//! Export of a finished run to other formats.
//!
//! [`Run`] contains the data of a result folder, grouped by track. [`export`] writes a run in one or more of the
//! [`FORMATS`]. Each format has its own folder. A folder appears only when it is complete.
//!
//! # Contents
//! - `run.rs`: the data of a result folder, grouped by track.
//! - `formats/`: one source file per format. `formats.rs` lists all formats in [`FORMATS`]. To add a format, add a
//!   source file and an entry in this list.
//! - `xml.rs`: writing of XML files.

#![deny(missing_docs)]

mod formats;
mod run;
mod xml;

use std::path::{Path, PathBuf};

use roadplane_write::{Existing, OutputFolder, WriteError};

pub use formats::{FORMATS, Format, write_paths};
pub use run::{Event, Run, RunSegment, Track};
pub use xml::{Element, fixed};

/// Writes a run in each of the given formats and returns the paths of the written folders.
///
/// The folder of a format is in `out`, and its name is the name of the format.
///
/// The caller must have a [`FolderLock`](roadplane_write::FolderLock) on `out`.
///
/// # Errors
/// [`WriteError::Lacks`] if the run lacks data that a format needs, [`WriteError::Exists`], [`WriteError::Io`], or
/// [`WriteError::DiskFull`]. Folders that were complete before the error remain.
pub fn export(
    run: &Run,
    formats: &[&Format],
    out: &Path,
    existing: Existing,
) -> Result<Vec<PathBuf>, WriteError> {
    let write = |format: &&Format| {
        if let Some(reason) = format.lacks(run) {
            let what = format!("the format {} {reason}", format.name);
            return Err(WriteError::Lacks { what, path: run.folder.clone() });
        }
        OutputFolder::write(out, format.name, existing, |folder| (format.write)(run, folder))
    };
    formats.iter().map(write).collect()
}
