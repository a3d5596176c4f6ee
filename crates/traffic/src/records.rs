//! The tables and their rows.
//!
//! Speeds are in km/h. If the user asks for miles per hour, the columns that end in `_kmh` end in `_mph` instead.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Conflict;

/// Place, kind of vehicles and period of a figure.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Group {
    /// Name of the camera.
    pub camera: String,
    /// Name of the gate or zone.
    pub place: String,
    /// Direction over a gate: `forward` (from its left to its right side, seen from its first to its last point) or
    /// `backward`. Empty for a zone.
    pub direction: String,
    /// Class of the vehicles, or `all`.
    pub class: String,
    /// Begin of the period: local time with its offset from UTC, or seconds since the begin of the clip if its date is
    /// unknown.
    pub from: String,
    /// End of the period.
    pub to: String,
    /// Time in the period in which vehicles were followed, s. Gaps between clips and time without a usable picture do not
    /// count.
    pub followed_s: f64,
}

/// A row of `counts`: the vehicles that cross a gate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CountRow {
    /// Place, kind of vehicles and period.
    #[serde(flatten)]
    pub group: Group,
    /// Number of vehicles that cross the gate. It is missing if no vehicle could be followed in the period.
    pub vehicles: Option<u64>,
    /// Lower end of the interval of 95 % of the number. It is missing for tracks without sds.
    pub vehicles_low: Option<u64>,
    /// Upper end of the interval of 95 % of the number.
    pub vehicles_high: Option<u64>,
    /// Vehicles per hour of followed time.
    pub flow_per_h: Option<f64>,
}

/// A row of `speeds`: the speeds at which vehicles cross a gate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SpeedRow {
    /// Place, kind of vehicles and period.
    #[serde(flatten)]
    pub group: Group,
    /// Number of vehicles.
    pub vehicles: u64,
    /// Mean of the speeds, km/h.
    pub mean_kmh: f64,
    /// Sd of `mean_kmh` from errors of measurement, km/h. It is missing for tracks without sds.
    pub mean_sd_kmh: Option<f64>,
    /// Space-mean speed (harmonic mean), km/h. It is missing if a vehicle was stationary on the line.
    pub space_mean_kmh: Option<f64>,
    /// Sd of `space_mean_kmh`, km/h.
    pub space_mean_sd_kmh: Option<f64>,
    /// Speed that 15 % of the vehicles do not exceed, km/h.
    pub v15_kmh: f64,
    /// Sd of `v15_kmh`, km/h.
    pub v15_sd_kmh: Option<f64>,
    /// Speed that half of the vehicles do not exceed, km/h.
    pub v50_kmh: f64,
    /// Sd of `v50_kmh`, km/h.
    pub v50_sd_kmh: Option<f64>,
    /// Speed that 85 % of the vehicles do not exceed, km/h.
    pub v85_kmh: f64,
    /// Sd of `v85_kmh`, km/h.
    pub v85_sd_kmh: Option<f64>,
}

/// A row of `speed_histogram`: the number of vehicles in a class of speeds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HistogramRow {
    /// Place, kind of vehicles and period.
    #[serde(flatten)]
    pub group: Group,
    /// Lower end of the class of speeds (inclusive), km/h.
    pub least_kmh: f64,
    /// Upper end of the class of speeds (exclusive), km/h.
    pub below_kmh: f64,
    /// Number of vehicles.
    pub vehicles: u64,
}

/// A row of `headways`: times between vehicles that cross a gate one after the other in one direction.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HeadwayRow {
    /// Place, kind of vehicles and period. The class is that of the follower.
    #[serde(flatten)]
    pub group: Group,
    /// Number of headways.
    pub headways: u64,
    /// Mean time from front to front, s.
    pub headway_mean_s: f64,
    /// Median time from front to front, s.
    pub headway_median_s: f64,
    /// Mean time from the rear of the leader to the front of the follower, s.
    pub gap_mean_s: f64,
    /// Share of the headways below 2 s, 0 to 1.
    pub below_2s_share: f64,
}

/// A row of `flows`: vehicles by the first and the last gate that they cross.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FlowRow {
    /// Place, kind of vehicles and period. `place` is the first gate, and the period is that of the first crossing.
    #[serde(flatten)]
    pub group: Group,
    /// The last gate. It is the same as `place` for vehicles that cross one gate only.
    pub to_place: String,
    /// Direction over the last gate.
    pub to_direction: String,
    /// Number of vehicles.
    pub vehicles: u64,
}

/// A row of `zones`: figures of a zone.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ZoneRow {
    /// Place, kind of vehicles and period.
    #[serde(flatten)]
    pub group: Group,
    /// Number of vehicles that enter the zone in the period.
    pub entered: u64,
    /// Number of stays that end in the period and were seen from their begin to their end.
    pub stays: u64,
    /// Mean time of these stays, s.
    pub time_mean_s: Option<f64>,
    /// Sd of `time_mean_s` from errors of measurement, s.
    pub time_mean_sd_s: Option<f64>,
    /// Mean time in which a vehicle is stationary during such a stay, s.
    pub stationary_mean_s: Option<f64>,
    /// Mean delay of these stays against the median speed of vehicles that do not stop in the zone, s. It is missing if
    /// every vehicle stops.
    pub delay_mean_s: Option<f64>,
    /// Share of the followed time in which at least one vehicle is in the zone, 0 to 1.
    pub occupancy: Option<f64>,
    /// Mean number of vehicles in the zone.
    pub vehicles_mean: Option<f64>,
    /// Largest number of vehicles in the zone at one time.
    pub vehicles_max: u64,
    /// Density: vehicles per km of the zone's length along the traffic (Edie 1963).
    pub density_per_km: Option<f64>,
    /// Flow: vehicles per hour, averaged over the zone (Edie 1963).
    pub flow_per_h: Option<f64>,
    /// Space-mean speed in the zone: path lengths divided by times (Edie 1963), km/h.
    pub speed_kmh: Option<f64>,
    /// Largest number of stationary vehicles in the zone at one time.
    pub queue_max_vehicles: u64,
    /// Largest distance from the foremost to the hindmost stationary vehicle at one time, m.
    pub queue_max_m: f64,
}

/// A row of `crossings`: one vehicle that crosses one gate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CrossingRow {
    /// Name of the camera.
    pub camera: String,
    /// Name of the clip.
    pub clip: String,
    /// Number of the track.
    pub track: u64,
    /// Class of the vehicle.
    pub class: String,
    /// Name of the gate.
    pub gate: String,
    /// Direction over the gate: `forward` or `backward`.
    pub direction: String,
    /// Time at which the centre of the vehicle is on the line, s in the clip.
    pub time_s: f64,
    /// Sd of `time_s` from the vehicle's own position error, s. It is missing for tracks without sds.
    pub time_sd_s: Option<f64>,
    /// Local time of the crossing with its offset from UTC. It is missing if the date of the clip is unknown.
    pub moment: Option<String>,
    /// Place of the crossing along the gate, from its first point, m.
    pub along_m: f64,
    /// Speed at the line, km/h.
    pub speed_kmh: f64,
    /// Sd of `speed_kmh`, km/h. It has the vehicle's own error and the error of the metric scale.
    pub speed_sd_kmh: Option<f64>,
    /// Time since the front of the vehicle before it crossed in the same direction, s. It is missing for the first vehicle
    /// and after time in which vehicles were not followed.
    pub headway_s: Option<f64>,
    /// Sd of `headway_s`, s.
    pub headway_sd_s: Option<f64>,
    /// Time since the rear of the vehicle before it crossed in the same direction, s. It is negative if both were on the
    /// line together, in two lanes.
    pub gap_s: Option<f64>,
    /// Probability that the vehicle crossed, 0 to 1.
    pub probability: f64,
}

/// A row of `lanes`: a lane of a gate in one period, all classes together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LaneRow {
    /// Place, direction and period.
    #[serde(flatten)]
    pub group: Group,
    /// Number of the lane among those of the direction, counted from the gate's first point, from 1 on.
    pub lane: u64,
    /// Number of vehicles. It is missing if no vehicle could be followed in the period.
    pub vehicles: Option<u64>,
    /// Mean speed at the line, km/h.
    pub mean_kmh: Option<f64>,
    /// Sd of `mean_kmh`, km/h.
    pub mean_sd_kmh: Option<f64>,
    /// Speed below which 85 % of the vehicles drive, km/h.
    pub v85_kmh: Option<f64>,
    /// Sd of `v85_kmh`, km/h.
    pub v85_sd_kmh: Option<f64>,
    /// Mean time from front to front in the lane, s.
    pub headway_mean_s: Option<f64>,
    /// Mean time from the rear of a vehicle to the front of the next one in the lane, s.
    pub gap_mean_s: Option<f64>,
}

/// A row of `stays`: one vehicle that is in one zone.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StayRow {
    /// Name of the camera.
    pub camera: String,
    /// Name of the clip.
    pub clip: String,
    /// Number of the track.
    pub track: u64,
    /// Class of the vehicle.
    pub class: String,
    /// Name of the zone.
    pub zone: String,
    /// Time at which the centre of the vehicle enters the zone, s in the clip. It is missing if the vehicle was not seen
    /// to enter.
    pub enters_s: Option<f64>,
    /// Time at which the centre of the vehicle leaves the zone, s in the clip. It is missing if the vehicle was not seen to
    /// leave.
    pub leaves_s: Option<f64>,
    /// Time in the zone, as far as the vehicle was followed, s.
    pub stay_s: f64,
    /// Sd of `stay_s` from the vehicle's own position error, s. It is missing for tracks without sds.
    pub stay_sd_s: Option<f64>,
    /// Time in which the vehicle was stationary, s.
    pub stationary_s: f64,
    /// Length of the vehicle's path in the zone, m.
    pub path_m: f64,
    /// Local time at which the stay begins, with its offset from UTC. It is missing if the date of the clip is unknown.
    pub moment: Option<String>,
}

/// A row of `conflicts`: two vehicles that came close to a collision.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ConflictRow {
    /// Name of the camera.
    pub camera: String,
    /// Name of the clip.
    pub clip: String,
    /// Local time of the conflict with its offset from UTC. It is missing if the date of the clip is unknown.
    pub moment: Option<String>,
    /// The conflict.
    #[serde(flatten)]
    pub conflict: Conflict,
}

/// The tables.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Figures {
    /// Numbers of vehicles by gate.
    pub counts: Vec<CountRow>,
    /// Speeds by gate.
    pub speeds: Vec<SpeedRow>,
    /// Histograms of speeds by gate.
    pub speed_histogram: Vec<HistogramRow>,
    /// Headways by gate.
    pub headways: Vec<HeadwayRow>,
    /// Figures by gate and lane. There are none for gates that the user gives.
    #[serde(default)]
    pub lanes: Vec<LaneRow>,
    /// Numbers of vehicles by first and last gate.
    pub flows: Vec<FlowRow>,
    /// Figures by zone.
    pub zones: Vec<ZoneRow>,
    /// Conflicts between vehicles.
    pub conflicts: Vec<ConflictRow>,
    /// Every crossing of a gate. It is only in the table `crossings`, not in `traffic.json`.
    #[serde(skip)]
    pub crossings: Vec<CrossingRow>,
    /// Number of pairs of vehicles that pass a limit and are not among the conflicts: their footprints overlap, or one of
    /// the vehicles overlaps with another at about this time.
    #[serde(skip)]
    pub doubtful_conflicts: u64,
    /// Every stay in a zone. It is only in the table `stays`, not in `traffic.json`.
    #[serde(skip)]
    pub stays: Vec<StayRow>,
}

impl Figures {
    /// Adds the rows of other tables.
    pub fn extend(&mut self, other: Self) {
        self.counts.extend(other.counts);
        self.speeds.extend(other.speeds);
        self.speed_histogram.extend(other.speed_histogram);
        self.headways.extend(other.headways);
        self.lanes.extend(other.lanes);
        self.flows.extend(other.flows);
        self.zones.extend(other.zones);
        self.conflicts.extend(other.conflicts);
        self.crossings.extend(other.crossings);
        self.stays.extend(other.stays);
        self.doubtful_conflicts += other.doubtful_conflicts;
    }
}
