//! Classes of vehicles.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The class of a vehicle, from the detector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VehicleClass {
    /// A car, van, pickup or SUV. The shape atlas covers this class.
    #[default]
    Car,
    /// A truck.
    Truck,
    /// A bus.
    Bus,
    /// A motorcycle or motor scooter with its riders. The original net, `detector_coco`, lacks this class.
    Motorcycle,
}

impl VehicleClass {
    /// All classes.
    pub const ALL: [Self; 4] = [Self::Car, Self::Truck, Self::Bus, Self::Motorcycle];

    /// Returns the name of the class in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Car => "car",
            Self::Truck => "truck",
            Self::Bus => "bus",
            Self::Motorcycle => "motorcycle",
        }
    }
}
