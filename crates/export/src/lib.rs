//! A finished run in the formats of others.
//!
//! [`Run`] is what a result folder holds, by track. [`export`] writes it in any of [`FORMATS`], a folder each, complete or not
//! there at all.

#![deny(missing_docs)]

mod formats;
mod place;
mod run;
mod survey;
mod utm;
mod xml;

use std::path::{Path, PathBuf};

use roadplane_write::{Existing, OutputFolder, WriteError};

pub use formats::{FORMATS, Format};
pub use place::{Fit, OnMap, Place};
pub use run::{Event, Run, Stretch, Track};
pub use survey::{SurveyPoint, read_points};
pub use utm::UtmZone;
pub use xml::{Element, fixed};

/// Writes a run in each format into a folder of the format's name. Hold a [`FolderLock`](roadplane_write::FolderLock) on
/// `out`. Gives the folders.
///
/// # Errors
/// [`WriteError::Malformed`] where the run lacks what a format holds, [`WriteError::Exists`], [`WriteError::Io`],
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

/// The nearest number with so many decimals; −0 becomes 0.
fn digits(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    (value * scale).round() / scale + 0.0
}
