//! Export of a finished run to other formats.
//!
//! [`Run`] is the contents of a result folder, by track. [`export`] writes it in any of [`FORMATS`], each into a folder
//! of its own. A folder appears complete or not at all.
//!
//! # Contents
//! - `run.rs`: a result folder, by track.
//! - `formats/`: a file for each format. `formats.rs` lists them in [`FORMATS`]. A new format is a file and an entry of
//!   the list.
//! - `xml.rs`: XML files.

#![deny(missing_docs)]

mod formats;
mod run;
mod xml;

use std::path::{Path, PathBuf};

use roadplane_write::{Existing, OutputFolder, WriteError};

pub use formats::{FORMATS, Format, write_paths};
pub use run::{Event, Run, RunSegment, Track};
pub use xml::{Element, fixed};

/// Writes a run in each format, into a folder with the name of the format, and returns the folders.
///
/// The caller keeps a [`FolderLock`](roadplane_write::FolderLock) on `out`.
///
/// # Errors
/// [`WriteError::Lacks`] if the run lacks data that a format needs, [`WriteError::Exists`], [`WriteError::Io`], or
/// [`WriteError::DiskFull`]. Folders of formats that were finished before remain.
pub fn export(
    run: &Run,
    formats: &[&Format],
    out: &Path,
    existing: Existing,
) -> Result<Vec<PathBuf>, WriteError> {
    let write = |format: &&Format| {
        let mut folder = OutputFolder::begin(out, format.name, existing)?;
        if folder.is_resumed() {
            folder.reset()?;
        }
        match (format.write)(run, folder.path()) {
            Ok(()) => folder.publish(),
            Err(error) => folder.discard().and(Err(error)),
        }
    };
    formats.iter().map(write).collect()
}
