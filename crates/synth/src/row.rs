//! A typical row of a result, for tests of code that reads rows.

use roadplane_base::{TrackRow, VehicleClass};

/// Returns a typical row of a stationary car 20 m ahead of the camera.
///
/// A test changes the fields that matter to it: `TrackRow { x_m: 3.0, ..stationary_row(1, 0, 0.0) }`.
#[must_use]
pub fn stationary_row(track: u64, frame: u64, time_s: f64) -> TrackRow {
    TrackRow {
        frame,
        time_s,
        track,
        x_m: 0.0,
        y_m: 20.0,
        heading_rad: 0.0,
        speed_mps: 0.0,
        x_sd_m: 0.1,
        y_sd_m: 0.2,
        heading_sd_rad: 0.02,
        length_m: 4.5,
        width_m: 1.8,
        height_m: 1.5,
        bbox_px: [100.0, 100.0, 160.0, 140.0],
        score: 0.9,
        observed: true,
        class: VehicleClass::Car,
        segment: 0,
        speed_sd_mps: 0.1,
        activity: None,
        activity_p: None,
        x_own_sd_m: None,
        y_own_sd_m: None,
        exists_p: None,
        same_vehicle_p: None,
        ground: 0,
        z_m: 0.0,
        on_map: None,
    }
}
