//! A vehicle in a frame of the result: a row of `tracks.*`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::vehicle_class::VehicleClass;
use crate::GroundPose;

/// One car in one frame of the result: a row of `tracks.*`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrackRow {
    /// Index of the frame.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Track's number, from 1.
    pub track: u64,
    /// World x of the car's origin, m.
    pub x_m: f64,
    /// World y of the car's origin, m.
    pub y_m: f64,
    /// 0 along +x, counter-clockwise, rad, (−π, π].
    pub heading_rad: f64,
    /// Speed over ground, m/s; negative when reversing.
    pub speed_mps: f64,
    /// sd of `x_m`, m: the car's own error and what all cars share, which is the camera's (`camera.json`).
    pub x_sd_m: f64,
    /// sd of `y_m`, m, likewise.
    pub y_sd_m: f64,
    /// sd of `heading_rad`, rad, likewise.
    pub heading_sd_rad: f64,
    /// Length of the vehicle, m, one per track.
    pub length_m: f64,
    /// Width without mirrors, m, one per track.
    pub width_m: f64,
    /// Height of the vehicle, m, one per track.
    pub height_m: f64,
    /// Box, px: measured, or projected where not observed.
    pub bbox_px: [f64; 4],
    /// Detector's score; less than makes a vehicle where a weak box shows one that is expected, 0 where not observed.
    pub score: f64,
    /// Seen in this frame, or filled in.
    pub observed: bool,
    /// Kind of vehicle, one per track.
    #[serde(default)]
    pub class: VehicleClass,
    /// Which of the `segments` of `camera.json` the coordinates belong to, from 0.
    #[serde(default)]
    pub segment: usize,
    /// sd of `speed_mps`, m/s, likewise; 0 in files of older versions.
    #[serde(default)]
    pub speed_sd_mps: f64,
    /// Activity, where asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activity: Option<String>,
    /// Its probability.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activity_p: Option<f64>,
    /// The part of `x_sd_m` that is the track's own, m: how far its places are off against each other, whatever the camera is off by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x_own_sd_m: Option<f64>,
    /// The same of `y_sd_m`, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y_own_sd_m: Option<f64>,
    /// Where it is on the map, where the camera's place was given; each field is a column.
    #[serde(flatten, default, skip_serializing_if = "Option::is_none")]
    pub on_map: Option<OnMap>,
}

/// Where a car's origin is on the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OnMap {
    /// Degrees, WGS 84.
    pub latitude: f64,
    /// Degrees, WGS 84.
    pub longitude: f64,
    /// UTM zone of the next four, such as `33N`; one a file.
    pub utm_zone: String,
    /// East in the zone, m.
    pub east_m: f64,
    /// North in the zone, m.
    pub north_m: f64,
    /// sd of `east_m`, m: the car's own error, the camera's and that of the camera's place.
    pub east_sd_m: f64,
    /// sd of `north_m`, m, likewise.
    pub north_sd_m: f64,
    /// Where the vehicle points, degrees clockwise from the zone's north.
    pub bearing_deg: f64,
}

impl TrackRow {
    /// Where it stands and how it is turned, world frame.
    #[must_use]
    pub fn pose(&self) -> GroundPose {
        GroundPose { x_m: self.x_m, y_m: self.y_m, heading_rad: self.heading_rad }
    }
}
