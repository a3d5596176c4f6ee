//! What a car does.

use serde::{Deserialize, Serialize};

/// What a car does in a frame.
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
