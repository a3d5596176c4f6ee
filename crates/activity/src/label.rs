//! The labels of activities, and their order in the output of the net.

use std::fmt;

use roadplane_base::Activity;
use serde::{Deserialize, Serialize};

/// Number of labels.
pub const LABELS: usize = 8;

/// Activity of a vehicle at one time.
///
/// A vehicle has exactly one label at a time. A vehicle that turns while it reverses is labelled as reversing. A
/// vehicle that turns while it starts is labelled as turning. The events of such a vehicle include both the turn and
/// the start ([`crate::event_spans`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Label {
    NotMoving,
    Moving,
    Starting,
    Stopping,
    TurningLeft,
    TurningRight,
    UTurn,
    Reversing,
}

impl Label {
    /// All labels, in the order of the net's output.
    pub const ALL: [Self; LABELS] = [
        Self::NotMoving,
        Self::Moving,
        Self::Starting,
        Self::Stopping,
        Self::TurningLeft,
        Self::TurningRight,
        Self::UTurn,
        Self::Reversing,
    ];

    /// Returns the name of the label in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NotMoving => "not_moving",
            Self::Moving => "moving",
            Self::Starting => "starting",
            Self::Stopping => "stopping",
            Self::TurningLeft => "turning_left",
            Self::TurningRight => "turning_right",
            Self::UTurn => "u_turn",
            Self::Reversing => "reversing",
        }
    }

    /// Returns the label with this name, if there is one.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|label| label.name() == name)
    }

    /// Returns the index of the label in the net's output.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }

    /// Returns the label of an activity in a truth file.
    ///
    /// The activity `parked` is labelled as not moving. The activity `parking` is labelled as reversing if the speed is
    /// negative. Otherwise it is labelled as a turn if the path's radius is below 20 m, and as stopping if not.
    ///
    /// `speed_mps` is negative when the car reverses. `curvature` is the curvature of the path, 1/m, positive to the
    /// left.
    #[must_use]
    pub fn of_truth(activity: Activity, speed_mps: f64, curvature: f64) -> Self {
        match activity {
            Activity::Parked => Self::NotMoving,
            Activity::Moving => Self::Moving,
            Activity::Starting => Self::Starting,
            Activity::Stopping => Self::Stopping,
            Activity::TurningLeft => Self::TurningLeft,
            Activity::TurningRight => Self::TurningRight,
            Activity::UTurn => Self::UTurn,
            Activity::Reversing => Self::Reversing,
            Activity::Parking if speed_mps < 0.0 => Self::Reversing,
            Activity::Parking if curvature > 0.05 => Self::TurningLeft,
            Activity::Parking if curvature < -0.05 => Self::TurningRight,
            Activity::Parking => Self::Stopping,
        }
    }
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_indices_agree_with_the_files() {
        for (index, label) in Label::ALL.into_iter().enumerate() {
            assert_eq!(label.index(), index);
            assert_eq!(Label::named(label.name()), Some(label));
            assert_eq!(serde_json::to_value(label).unwrap(), label.name());
        }
        assert_eq!(Label::named("flying"), None);
    }

    #[test]
    fn parking_is_labelled_by_the_motion() {
        assert_eq!(Label::of_truth(Activity::Parking, -1.0, 0.2), Label::Reversing);
        assert_eq!(Label::of_truth(Activity::Parking, 1.0, -0.2), Label::TurningRight);
        assert_eq!(Label::of_truth(Activity::Parking, 1.0, 0.01), Label::Stopping);
    }
}
