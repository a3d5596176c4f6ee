//! Driving activities of a vehicle.

use serde::{Deserialize, Serialize};

/// The activity of a vehicle in one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Activity {
    Parked,
    Moving,
    TurningLeft,
    TurningRight,
    UTurn,
    Stopping,
    Starting,
    Reversing,
    Parking,
}
