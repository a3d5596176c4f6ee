//! The run's rows, as in `tracks.csv`; with a place, longitude and latitude (WGS 84), the UTM zone's metres with their sds, and the
//! direction that the vehicle points in.

use std::path::Path;

use roadplane_write::{TrackCsv, WriteError};

use super::files::write_place;
use crate::Run;

/// By frame, then track; a file for each stretch of time.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for stretch in &run.stretches {
        let path = folder.join(format!("{}.csv", stretch.name));
        let mut file = TrackCsv::create(&path, run.place.is_some())?;
        for (_, row) in run.rows().into_iter().filter(|(_, row)| stretch.holds(row)) {
            file.write(row)?;
        }
        file.finish()?;
    }
    write_place(run, folder)
}
