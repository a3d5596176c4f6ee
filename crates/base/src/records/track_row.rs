//! One vehicle in one frame of the result: a row of `tracks.*`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::vehicle_class::VehicleClass;
use crate::GroundPose;
use nalgebra::{Isometry3, Translation3};

/// One vehicle in one frame: a row of `tracks.parquet`, `tracks.csv` and `tracks.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tracks: one row per vehicle and frame")]
pub struct TrackRow {
    /// Index of the frame in its input, from 0.
    pub frame: u64,
    /// Presentation time of the frame, s.
    pub time_s: f64,
    /// Number of the track, from 1.
    #[schemars(range(min = 1))]
    pub track: u64,
    /// World x of the vehicle's position, m. The position is the point on the ground midway between the axles.
    pub x_m: f64,
    /// World y of the vehicle's position, m. The position is the point on the ground midway between the axles.
    pub y_m: f64,
    /// Heading, rad, in (−π, π]: 0 along world +x, counter-clockwise as seen from above.
    pub heading_rad: f64,
    /// Speed along the heading, m/s. It is negative if the vehicle reverses, and 0 if it is stationary.
    pub speed_mps: f64,
    /// Standard deviation (sd) of `x_m`, m. It covers the vehicle's own error and the camera's error, which all
    /// vehicles share.
    #[schemars(range(min = 0))]
    pub x_sd_m: f64,
    /// Sd of `y_m`, m. It covers the vehicle's own error and the camera's error, which all vehicles share.
    #[schemars(range(min = 0))]
    pub y_sd_m: f64,
    /// Sd of `heading_rad`, rad. It covers the vehicle's own error and the camera's error, which all vehicles share.
    #[schemars(range(min = 0))]
    pub heading_sd_rad: f64,
    /// Length of the vehicle, m. All rows of a track have the same value.
    #[schemars(range(min = 0))]
    pub length_m: f64,
    /// Width of the vehicle without mirrors, m. All rows of a track have the same value.
    #[schemars(range(min = 0))]
    pub width_m: f64,
    /// Height of the vehicle, m. All rows of a track have the same value.
    #[schemars(range(min = 0))]
    pub height_m: f64,
    /// Box of the vehicle in the picture: left, top, right, bottom, px. The box is measured if `observed` is true. If
    /// not, it is projected from the estimated pose. The measured boxes before and after it correct its edges.
    pub bbox_px: [f64; 4],
    /// Score of the detector, 0 to 1. A score below the detector's threshold means that a weak detection continued the
    /// track. The score is 0 if `observed` is false.
    #[schemars(range(min = 0, max = 1))]
    pub score: f64,
    /// Whether the vehicle was detected in this frame. The detection of a stationary vehicle may be carried over from
    /// an earlier frame. If false, the row is interpolated: the nets did not run on the frame, or the vehicle was
    /// missed or hidden.
    pub observed: bool,
    /// Class of the vehicle. All rows of a track have the same value.
    #[serde(default)]
    pub class: VehicleClass,
    /// Index of the camera segment, from 0. The coordinates are in the world frame of this segment. `camera.json` lists
    /// the `segments`.
    #[serde(default)]
    pub segment: usize,
    /// Sd of `speed_mps`, m/s. It covers the vehicle's own error and the camera's error, which all vehicles share. For
    /// a stationary vehicle it is small and fixed, 0.001 m/s. Files of older versions lack this column, and their sd is
    /// read as 0.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub speed_sd_mps: f64,
    /// Activity of the vehicle: `not_moving`, `moving`, `starting`, `stopping`, `turning_left`, `turning_right`,
    /// `u_turn` or `reversing`. It is absent if activities are turned off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activity: Option<String>,
    /// Probability of `activity`, 0 to 1. It is present if `activity` is present.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0, max = 1))]
    pub activity_p: Option<f64>,
    /// The vehicle's own part of `x_sd_m`, without the camera's error, m. It is the sd of the vehicle's positions
    /// relative to each other. The square of `x_sd_m` is the sum of the squares of this part and of the camera's part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0))]
    pub x_own_sd_m: Option<f64>,
    /// The vehicle's own part of `y_sd_m`, without the camera's error, m. It is the sd of the vehicle's positions
    /// relative to each other. The square of `y_sd_m` is the sum of the squares of this part and of the camera's part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0))]
    pub y_own_sd_m: Option<f64>,
    /// Probability that the track is a vehicle, 0 to 1. All rows of a track have the same value. It is absent in files
    /// of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0, max = 1))]
    pub exists_p: Option<f64>,
    /// Probability that the vehicle after a gap is the same as before it, 0 to 1. It is present where the track was joined
    /// over a time without detections: in the rows of that time, and in the first row after it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0, max = 1))]
    pub same_vehicle_p: Option<f64>,
    /// Number of the plane below the vehicle, from 0, in the list `ground` of `camera.json`. It is 0 if the ground is one
    /// plane, and in files of older versions.
    #[serde(default)]
    pub ground: usize,
    /// World z of the vehicle's position, m: the height above the first plane. It is 0 if the ground is one plane, and in
    /// files of older versions.
    #[serde(default)]
    pub z_m: f64,
    /// Position on the map, present if the user gave the camera's position. Each of its fields is a column.
    #[serde(flatten, default, skip_serializing_if = "Option::is_none")]
    pub on_map: Option<OnMap>,
}

/// Position and heading of a vehicle on the map. The position is the point on the ground midway between the axles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OnMap {
    /// Latitude of the vehicle's position, degrees, WGS 84. This column and the next seven are present if the user gave
    /// the camera's position on the map.
    #[schemars(range(min = -90, max = 90))]
    pub latitude: f64,
    /// Longitude of the vehicle's position, degrees, WGS 84.
    #[schemars(range(min = -180, max = 180))]
    pub longitude: f64,
    /// UTM zone of the columns `east_m` to `bearing_deg`, such as `33N`. All rows of a file have the same zone.
    pub utm_zone: String,
    /// Easting of the vehicle's position in the UTM zone, m.
    pub east_m: f64,
    /// Northing of the vehicle's position in the UTM zone, m.
    pub north_m: f64,
    /// Sd of `east_m`, m. It covers the errors of the vehicle, of the camera and, with `--geo`, of the camera's
    /// position on the map. With `--camera-at`, the errors of the camera's position and bearing on the map are not
    /// included.
    #[schemars(range(min = 0))]
    pub east_sd_m: f64,
    /// Sd of `north_m`, m. It covers the errors of the vehicle, of the camera and, with `--geo`, of the camera's
    /// position on the map. With `--camera-at`, the errors of the camera's position and bearing on the map are not
    /// included.
    #[schemars(range(min = 0))]
    pub north_sd_m: f64,
    /// Heading of the vehicle on the map, degrees clockwise from the grid north of the UTM zone.
    #[schemars(range(min = 0, max = 360))]
    pub bearing_deg: f64,
}

impl TrackRow {
    /// Returns the vehicle's position and heading in the world frame.
    #[must_use]
    pub fn pose(&self) -> GroundPose {
        GroundPose { x_m: self.x_m, y_m: self.y_m, heading_rad: self.heading_rad }
    }

    /// Returns the rigid motion from the vehicle's frame to the world frame, m. The vehicle is vertical on any plane.
    #[must_use]
    pub fn world_from_car(&self) -> Isometry3<f64> {
        Translation3::new(0.0, 0.0, self.z_m) * self.pose().world_from_car()
    }
}
