//! A finished run in the formats of others.
//!
//! [`Run`] is what a result folder holds, by track. [`export`] writes it in any of [`FORMATS`], a folder each, complete or not
//! there at all.
//!
//! # Contents
//! `run.rs` a result folder by track; `formats/` a file each, listed in [`FORMATS`] (`formats.rs`); `xml.rs`. A new format is a file
//! there and a line in the list.

#![deny(missing_docs)]

mod formats;
mod run;
mod xml;

use std::path::{Path, PathBuf};

use roadplane_write::{Existing, OutputFolder, WriteError};

pub use formats::{FORMATS, Format, write_ways};
pub use run::{Event, Run, Stretch, Track};
pub use xml::{Element, fixed};

/// Writes a run in each format into a folder of the format's name. Hold a [`FolderLock`](roadplane_write::FolderLock) on
/// `out`. Gives the folders.
///
/// # Errors
/// [`WriteError::Lacks`] where the run lacks what a format holds, [`WriteError::Exists`], [`WriteError::Io`],
/// [`WriteError::DiskFull`]; folders of formats that were finished before stay.
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
