//! Rounding of the numbers in files. The rounding steps are far smaller than the uncertainties.

use roadplane_base::{OnMap, PoseRecord, TrackRow};

/// Number of decimals for values in metres and in metres per second.
pub(crate) const METRES: i32 = 4;
/// Number of decimals for values in radians.
pub(crate) const RADIANS: i32 = 5;
/// Number of decimals for values in pixels.
pub(crate) const PIXELS: i32 = 2;
/// Number of decimals for scores and probabilities.
pub(crate) const SCORE: i32 = 4;
/// Number of decimals for values in seconds.
pub(crate) const SECONDS: i32 = 6;
/// Number of decimals for a latitude or longitude in degrees. One step is about a tenth of a millimetre on the ground.
pub(crate) const DEGREES: i32 = 9;
/// Number of decimals for a bearing in degrees.
pub(crate) const BEARING: i32 = 3;
/// Number of decimals in the matrix of a rigid motion.
const MOTION: i32 = 6;

/// Rounds a number to `digits` decimals. −0 becomes 0.
#[must_use]
pub fn decimals(value: f64, digits: i32) -> f64 {
    let scale = 10f64.powi(digits);
    let rounded = (value * scale).round() / scale;
    if rounded.is_finite() { rounded + 0.0 } else { value }
}

/// Rounds a number to `digits` significant digits.
pub(crate) fn significant(value: f64, digits: i32) -> f64 {
    if !value.is_finite() || value.abs() < f64::MIN_POSITIVE {
        return if value.is_finite() { 0.0 } else { value };
    }
    // The number is rounded as text, because scaling by powers of ten is not exact for very small numbers.
    let places = usize::try_from(digits - 1).unwrap_or(0);
    format!("{value:.places$e}").parse().unwrap_or(value)
}

/// Returns a row with its numbers rounded to the decimals that the track files have.
#[must_use]
pub fn rounded_row(row: &TrackRow) -> TrackRow {
    let metres = |v| decimals(v, METRES);
    let radians = |v| decimals(v, RADIANS);
    TrackRow {
        time_s: decimals(row.time_s, SECONDS),
        x_m: metres(row.x_m),
        y_m: metres(row.y_m),
        heading_rad: radians(row.heading_rad),
        speed_mps: metres(row.speed_mps),
        x_sd_m: metres(row.x_sd_m),
        y_sd_m: metres(row.y_sd_m),
        heading_sd_rad: radians(row.heading_sd_rad),
        speed_sd_mps: metres(row.speed_sd_mps),
        length_m: metres(row.length_m),
        width_m: metres(row.width_m),
        height_m: metres(row.height_m),
        bbox_px: row.bbox_px.map(|v| decimals(v, PIXELS)),
        score: decimals(row.score, SCORE),
        activity_p: row.activity_p.map(|p| decimals(p, SCORE)),
        x_own_sd_m: row.x_own_sd_m.map(metres),
        y_own_sd_m: row.y_own_sd_m.map(metres),
        exists_p: row.exists_p.map(|p| decimals(p, SCORE)),
        same_vehicle_p: row.same_vehicle_p.map(|p| decimals(p, SCORE)),
        z_m: metres(row.z_m),
        on_map: row.on_map.as_ref().map(rounded_on_map),
        ..row.clone()
    }
}

fn rounded_on_map(at: &OnMap) -> OnMap {
    let metres = |v| decimals(v, METRES);
    OnMap {
        latitude: decimals(at.latitude, DEGREES),
        longitude: decimals(at.longitude, DEGREES),
        utm_zone: at.utm_zone.clone(),
        east_m: metres(at.east_m),
        north_m: metres(at.north_m),
        east_sd_m: metres(at.east_sd_m),
        north_sd_m: metres(at.north_sd_m),
        bearing_deg: decimals(at.bearing_deg, BEARING),
    }
}

/// Returns the name of the first number in a row that is infinite or NaN; `None` if all numbers are finite.
pub(crate) fn not_finite(row: &TrackRow) -> Option<&'static str> {
    let [x0, y0, x1, y1] = row.bbox_px;
    let numbers = [
        ("time_s", row.time_s),
        ("x_m", row.x_m),
        ("y_m", row.y_m),
        ("heading_rad", row.heading_rad),
        ("speed_mps", row.speed_mps),
        ("x_sd_m", row.x_sd_m),
        ("y_sd_m", row.y_sd_m),
        ("heading_sd_rad", row.heading_sd_rad),
        ("speed_sd_mps", row.speed_sd_mps),
        ("length_m", row.length_m),
        ("width_m", row.width_m),
        ("height_m", row.height_m),
        ("bbox_px", x0 + y0 + x1 + y1),
        ("score", row.score),
        ("activity_p", row.activity_p.unwrap_or(0.0)),
        ("x_own_sd_m", row.x_own_sd_m.unwrap_or(0.0)),
        ("y_own_sd_m", row.y_own_sd_m.unwrap_or(0.0)),
        ("exists_p", row.exists_p.unwrap_or(0.0)),
        ("same_vehicle_p", row.same_vehicle_p.unwrap_or(0.0)),
        ("z_m", row.z_m),
    ];
    let on_map = row.on_map.iter().flat_map(|at| {
        let degrees =
            [("latitude", at.latitude), ("longitude", at.longitude), ("bearing_deg", at.bearing_deg)];
        let metres = [("east_m", at.east_m), ("north_m", at.north_m)];
        degrees.into_iter().chain(metres).chain([("east_sd_m", at.east_sd_m), ("north_sd_m", at.north_sd_m)])
    });
    numbers.into_iter().chain(on_map).find(|(_, value)| !value.is_finite()).map(|(name, _)| name)
}

/// Returns a pose with its numbers rounded to the decimals that `poses.jsonl` has. A standard deviation that is not
/// finite becomes `None`.
pub(crate) fn rounded_pose(pose: &PoseRecord) -> PoseRecord {
    let motion = |rows: [[f64; 4]; 4]| rows.map(|row| row.map(|v| decimals(v, MOTION)));
    PoseRecord {
        time_s: decimals(pose.time_s, SECONDS),
        bbox_px: pose.bbox_px.map(|v| decimals(v, PIXELS)),
        score: decimals(pose.score, SCORE),
        world_from_car: motion(pose.world_from_car),
        camera_from_car: motion(pose.camera_from_car),
        shape: pose.shape.map(|v| decimals(v, SCORE)),
        dims_m: pose.dims_m.map(|v| decimals(v, METRES)),
        pose_sd: pose.pose_sd.map(|sd| sd.filter(|v| v.is_finite()).map(|v| significant(v, 4))),
        keypoints_px: pose
            .keypoints_px
            .iter()
            .map(|p| {
                p.map(|[x, y, score, sd]| {
                    [decimals(x, PIXELS), decimals(y, PIXELS), decimals(score, SCORE), decimals(sd, 3)]
                })
            })
            .collect(),
        reprojection_rms_px: decimals(pose.reprojection_rms_px, 3),
        ..pose.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounded_numbers_print_short() {
        assert_eq!(decimals(1.234_56, 4).to_string(), "1.2346");
        assert_eq!(decimals(-0.000_01, 4).to_string(), "0");
        assert_eq!(decimals(0.1 + 0.2, 6).to_string(), "0.3");
        assert_eq!(significant(1.234_567e-9, 4), 1.235e-9);
        assert_eq!(significant(0.0, 4), 0.0);
        assert!(decimals(f64::NAN, 4).is_nan() && significant(f64::INFINITY, 4).is_infinite());
    }
}
