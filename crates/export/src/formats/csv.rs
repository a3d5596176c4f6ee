//! The run's rows, as in `tracks.csv`.
//!
//! With a position on the map they also have longitude and latitude (WGS 84), metres in the UTM zone with their sds,
//! and the bearing of the vehicle.

use std::path::Path;

use roadplane_write::{TrackCsv, WriteError};

use super::files::write_place;
use crate::Run;

/// Writes the rows by frame, then track, into a file for each segment.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for segment in &run.segments {
        let path = folder.join(format!("{}.csv", segment.name));
        let mut file = TrackCsv::create(&path, run.place.is_some())?;
        for (_, row) in run.rows().into_iter().filter(|(_, row)| segment.contains(row)) {
            file.write(row)?;
        }
        file.finish()?;
    }
    write_place(run, folder)
}
