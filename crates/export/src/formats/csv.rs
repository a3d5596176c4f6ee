//! The run's rows with class and place: longitude and latitude (WGS 84), the UTM zone's metres with their sds, and the direction
//! that the vehicle points in. Without a place these are empty.

use std::path::Path;

use roadplane_write::WriteError;

use super::csv_table::write_table;
use super::write_place;
use crate::{Run, fixed};

const HEADER: [&str; 29] = [
    "frame",
    "time_s",
    "track",
    "class",
    "x_m",
    "y_m",
    "heading_rad",
    "speed_mps",
    "x_sd_m",
    "y_sd_m",
    "heading_sd_rad",
    "length_m",
    "width_m",
    "height_m",
    "bbox_x0_px",
    "bbox_y0_px",
    "bbox_x1_px",
    "bbox_y1_px",
    "score",
    "observed",
    "activity",
    "latitude",
    "longitude",
    "utm_zone",
    "east_m",
    "north_m",
    "east_sd_m",
    "north_sd_m",
    "bearing_deg",
];

/// By frame, then track; a file for each stretch of time.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for stretch in &run.stretches {
        let mut lines = Vec::new();
        for (track, row) in run.rows().into_iter().filter(|(_, row)| stretch.holds(row)) {
            let mut line = [const { String::new() }; HEADER.len()];
            let [x0, y0, x1, y1] = row.bbox_px;
            let known = [
                row.frame.to_string(),
                fixed(row.time_s, 6),
                row.track.to_string(),
                track.class.name().to_owned(),
                fixed(row.x_m, 4),
                fixed(row.y_m, 4),
                fixed(row.heading_rad, 5),
                fixed(row.speed_mps, 4),
                fixed(row.x_sd_m, 4),
                fixed(row.y_sd_m, 4),
                fixed(row.heading_sd_rad, 5),
                fixed(row.length_m, 4),
                fixed(row.width_m, 4),
                fixed(row.height_m, 4),
                fixed(x0, 2),
                fixed(y0, 2),
                fixed(x1, 2),
                fixed(y1, 2),
                fixed(row.score, 4),
                row.observed.to_string(),
                row.activity.clone().unwrap_or_default(),
            ];
            let (first, rest) = line.split_at_mut(known.len());
            first.clone_from_slice(&known);
            if let (Some(at), Some(place)) = (run.on_map(row)?, &run.place) {
                let place = [
                    fixed(at.degrees[0], 9),
                    fixed(at.degrees[1], 9),
                    place.zone.name(),
                    fixed(at.utm_m[0], 4),
                    fixed(at.utm_m[1], 4),
                    fixed(at.sd_m[0], 4),
                    fixed(at.sd_m[1], 4),
                    fixed(at.bearing_deg, 3),
                ];
                rest.clone_from_slice(&place);
            }
            lines.push(line);
        }
        write_table(&folder.join(format!("{}.csv", stretch.name)), &HEADER, lines)?;
    }
    write_place(run, folder)
}
