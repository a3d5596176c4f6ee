//! NGSIM (US Federal Highway Administration): one table in feet, feet per second and milliseconds.
//!
//! The position of a vehicle is the middle of its front bumper. `Local_X` increases to the right of the camera, and
//! `Local_Y` increases away from the camera. A run contains no lanes, so all columns about lanes are 0.

use std::path::Path;

use roadplane_base::VehicleClass;
use roadplane_write::WriteError;

use super::csv_table::write_table;
use crate::{Run, fixed};

const FEET_PER_METRE: f64 = 1.0 / 0.3048;

const HEADER: [&str; 18] = [
    "Vehicle_ID",
    "Frame_ID",
    "Total_Frames",
    "Global_Time",
    "Local_X",
    "Local_Y",
    "Global_X",
    "Global_Y",
    "v_Length",
    "v_Width",
    "v_Class",
    "v_Vel",
    "v_Acc",
    "Lane_ID",
    "Preceding",
    "Following",
    "Space_Headway",
    "Time_Headway",
];

/// Writes one table per segment. The rows are sorted by vehicle and then by frame, as in NGSIM's own tables.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for segment in &run.segments {
        let mut lines = Vec::new();
        for track in &run.tracks {
            let count = track.rows.iter().filter(|row| segment.contains(row)).count();
            let rows = track.rows.iter().zip(track.accelerations());
            for (row, acceleration) in rows.filter(|(row, _)| segment.contains(row)) {
                let feet = |metres: f64| fixed(metres * FEET_PER_METRE, 3);
                let front = track.front(row);
                let class = match track.class {
                    VehicleClass::Motorcycle => "1",
                    VehicleClass::Car => "2",
                    VehicleClass::Truck | VehicleClass::Bus => "3",
                };
                let [x, y, none] = [feet(front.x), feet(front.y), "0".to_owned()];
                // With a position on the map, the global coordinates are the easting and northing of the car's origin
                // in the UTM zone.
                let [east, north] = match &row.on_map {
                    Some(at) => [at.east_m, at.north_m].map(feet),
                    None => [x.clone(), y.clone()],
                };
                lines.push([
                    track.id.to_string(),
                    row.frame.to_string(),
                    count.to_string(),
                    fixed(row.time_s * 1e3, 0),
                    x,
                    y,
                    east,
                    north,
                    feet(row.length_m),
                    feet(row.width_m),
                    class.to_owned(),
                    feet(row.speed_mps),
                    feet(acceleration),
                    none.clone(),
                    none.clone(),
                    none.clone(),
                    none.clone(),
                    none,
                ]);
            }
        }
        write_table(&folder.join(format!("{}.csv", segment.name)), &HEADER, lines)?;
    }
    Ok(())
}
