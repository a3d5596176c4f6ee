//! CSV: the rows of the run, with the columns of `tracks.csv`.
//!
//! If the run has a position on the map, there are further columns. They are latitude and longitude (WGS 84), UTM
//! coordinates in metres with their standard deviations, and the bearing of the vehicle.

use std::path::Path;

use roadplane_write::{TrackCsv, WriteError};

use super::files::write_place;
use crate::Run;

/// Writes one file per segment, with rows sorted by frame and then by track.
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
