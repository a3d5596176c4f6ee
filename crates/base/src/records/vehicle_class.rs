//! Kinds of vehicles.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What kind of vehicle a detector says it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VehicleClass {
    /// Cars, vans, pickups, SUVs: what the atlas covers.
    #[default]
    Car,
    /// Lorries.
    Truck,
    /// Buses.
    Bus,
}

impl VehicleClass {
    /// Its name, as files have it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Car => "car",
            Self::Truck => "truck",
            Self::Bus => "bus",
        }
    }
}
