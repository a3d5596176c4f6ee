//! The file `traffic.json`.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::clock::Clock;
use crate::records::Figures;
use crate::site::{Site, SiteClip};

/// Schema id of `traffic.json`.
pub const TRAFFIC_SCHEMA: &str = "roadplane.traffic/1";

/// Units of speeds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Units {
    /// Kilometres per hour.
    #[default]
    Kmh,
    /// Miles per hour.
    Mph,
}

/// Kilometres in a mile.
const KM_PER_MILE: f64 = 1.609_344;

impl Units {
    /// Converts a speed from km/h.
    #[must_use]
    pub fn of_kmh(self, kmh: f64) -> f64 {
        match self {
            Self::Kmh => kmh,
            Self::Mph => kmh / KM_PER_MILE,
        }
    }

    /// Returns the name of the unit on pages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Kmh => "km/h",
            Self::Mph => "mph",
        }
    }
}

/// The figures of traffic: one object for all cameras. The rows of its lists are also in a table each.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "traffic: figures of traffic of one or more cameras")]
pub struct TrafficFile {
    /// Id of the schema: `roadplane.traffic/1`.
    #[schemars(extend("const" = TRAFFIC_SCHEMA))]
    pub schema: String,
    /// Length of the periods, such as `15min`.
    pub every: String,
    /// Time zone of the local times.
    pub time_zone: String,
    /// Units of speeds in this file and in the tables. For miles per hour, the keys that end in `_kmh` end in `_mph`.
    pub units: Units,
    /// The cameras.
    pub cameras: Vec<TrafficCamera>,
    /// Warnings about the figures, one sentence each.
    pub warnings: Vec<String>,
    /// The tables.
    #[serde(flatten)]
    pub figures: Figures,
}

/// A camera and its clips.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrafficCamera {
    /// Name of the camera.
    pub name: String,
    /// The clips in the order of time.
    pub clips: Vec<TrafficClip>,
    /// Gates and zones in the world frame of the first clip.
    pub places: Vec<TrafficPlace>,
}

/// A clip of a camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrafficClip {
    /// Name of the clip.
    pub name: String,
    /// Local time of the first frame with its offset from UTC. It is missing if the date is unknown.
    pub from: Option<String>,
    /// Time in which vehicles were followed, s.
    pub followed_s: f64,
    /// Time in which vehicles could not be followed, s.
    pub not_followed_s: f64,
    /// Number of vehicles.
    pub vehicles: u64,
}

/// A gate or a zone.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrafficPlace {
    /// Name of the gate or zone.
    pub name: String,
    /// Whether it is a zone (an area). If not, it is a gate (a line).
    pub is_zone: bool,
    /// Points in the world frame, m.
    pub points_m: Vec<[f64; 2]>,
}

impl TrafficCamera {
    /// Returns the description of a camera.
    #[must_use]
    pub fn of(site: &Site, clock: &Clock) -> Self {
        let clip = |c: &SiteClip| {
            let [from, to] = c.clip.span_s;
            let followed_s = c.clip.followed_s(from, to);
            TrafficClip {
                name: c.clip.name.clone(),
                from: c.clip.start_s.map(|start| clock.label(start)),
                followed_s,
                not_followed_s: to - from - followed_s,
                vehicles: c.clip.vehicles.len() as u64,
            }
        };
        let place = |name: &str, is_zone: bool, points: &[Vector2<f64>]| TrafficPlace {
            name: name.to_owned(),
            is_zone,
            points_m: points.iter().map(|p| [p.x, p.y]).collect(),
        };
        let first = site.clips.first();
        let gates = first.into_iter().flat_map(|c| &c.gates).map(|g| place(&g.name, false, &g.line));
        let zones = first.into_iter().flat_map(|c| &c.zones).map(|z| place(&z.name, true, &z.outline));
        Self {
            name: site.name.clone(),
            clips: site.clips.iter().map(clip).collect(),
            places: gates.chain(zones).collect(),
        }
    }
}
