//! A conflict between two vehicles, and the limits below which it is listed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::normal;

/// How the paths of two vehicles meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ConflictKind {
    /// The headings differ by less than 30° where each vehicle enters the other one's path.
    #[default]
    Following,
    /// The headings differ by 30° or more at an entry, and by less than 30° where the paths part or end.
    Merging,
    /// The headings differ by 30° or more at an entry and where the paths part, and by less than 150° at one of them.
    Crossing,
    /// The headings differ by 150° or more at the entry and where the paths part.
    Oncoming,
}

/// Where a vehicle is expected to go after a moment, for time to collision and deceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Projection {
    /// Along the path that it took later, at its present speed. Beyond the end of its track it goes straight on.
    /// SSAM projects in this manner; SUMO projects along lanes. A driver who swerves hides a conflict.
    #[default]
    Path,
    /// Straight on along its heading, at its present speed. On curved roads this expects contacts that nobody has to avoid.
    Straight,
}

/// Which conflicts are listed, and how they are found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ConflictLimits {
    /// Post-encroachment time below which a conflict is serious, s.
    pub serious_pet_s: f64,
    /// Post-encroachment time below which a conflict is listed, s.
    pub pet_s: f64,
    /// Time to collision below which a conflict is listed, s.
    pub ttc_s: f64,
    /// Deceleration to avoid a crash above which a conflict is listed, m/s².
    pub drac_mps2: f64,
    /// Probability that a time to collision or a deceleration passes its limit, from which a conflict is listed even if
    /// its value does not pass it.
    pub listed_p: f64,
    /// Speed of the faster vehicle from which a contact counts, m/s. Slower contacts are those of queues.
    pub least_speed_mps: f64,
    /// Longest time to collision that is computed, s. It must not be shorter than `ttc_s`.
    pub horizon_s: f64,
    /// Where a vehicle is expected to go.
    pub projection: Projection,
}

impl Default for ConflictLimits {
    fn default() -> Self {
        Self {
            serious_pet_s: 1.5,
            pet_s: 5.0,
            ttc_s: 1.5,
            drac_mps2: 3.35,
            listed_p: 0.05,
            // 10 ft/s: the limit of high-speed conflicts in evaluations with SSAM by the US Federal Highway Administration.
            least_speed_mps: 3.05,
            horizon_s: 5.0,
            projection: Projection::Path,
        }
    }
}

/// A row of `conflicts`: two vehicles that came close to a collision.
///
/// Sds contain the vehicles' own errors of position and speed. The shared error of the metric scale cancels in times,
/// and is a part of the sd of the deceleration. Sds and probabilities between 0 and 1 are missing for tracks without
/// sds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Conflict {
    /// Track of the vehicle that is first at the place: the leader of two that follow each other.
    pub first: u64,
    /// Track of the vehicle that is second at the place.
    pub second: u64,
    /// How their paths meet.
    pub kind: ConflictKind,
    /// Angle between the headings, 0 to 180°: where the second vehicle enters the first one's path, or else at the
    /// expected contact.
    pub angle_deg: f64,
    /// Time of the conflict, s: the second vehicle's entry, or else the time of the shortest time to collision.
    pub at_s: f64,
    /// World x of the place of the conflict, m: of the second vehicle's entry, or else of the expected contact.
    pub x_m: f64,
    /// World y of the place of the conflict, m.
    pub y_m: f64,
    /// Post-encroachment time, s: from the first vehicle's exit to the second one's entry. It is missing for vehicles
    /// that follow each other, and if it is longer than the limit.
    pub pet_s: Option<f64>,
    /// Sd of `pet_s`, s.
    pub pet_sd_s: Option<f64>,
    /// Probability that the post-encroachment time is below the limit of serious conflicts.
    pub pet_serious_p: Option<f64>,
    /// Probability that the post-encroachment time is below the limit of listed conflicts.
    pub pet_below_p: Option<f64>,
    /// Shortest time to collision, s. It is missing if no contact was expected within the horizon.
    pub min_ttc_s: Option<f64>,
    /// Sd of `min_ttc_s`, s.
    pub min_ttc_sd_s: Option<f64>,
    /// Probability that the shortest time to collision is below its limit.
    pub min_ttc_below_p: Option<f64>,
    /// Time of the shortest time to collision, s.
    pub min_ttc_at_s: Option<f64>,
    /// Speed at which the vehicles close in then, m/s: the length of the difference of their velocities.
    pub relative_speed_mps: Option<f64>,
    /// Highest deceleration to avoid a crash, m/s². It is missing if no contact was expected within the horizon, or
    /// if braking avoids none.
    pub max_drac_mps2: Option<f64>,
    /// Sd of `max_drac_mps2`, m/s².
    pub max_drac_sd_mps2: Option<f64>,
    /// Probability that the highest deceleration is above its limit.
    pub max_drac_above_p: Option<f64>,
    /// Time of the highest deceleration, s.
    pub max_drac_at_s: Option<f64>,
    /// Probability that both vehicles exist.
    pub exist_p: f64,
}

impl Conflict {
    /// Whether the footprints overlap at a time at which both vehicles are observed. Only a crash would look like this, and
    /// errors of positions and lengths are much more frequent.
    #[must_use]
    pub fn is_overlap(&self) -> bool {
        self.min_ttc_s.is_some_and(|ttc| ttc <= 0.0) || self.pet_s.is_some_and(|pet| pet < 0.0)
    }

    /// Whether a conflict is listed.
    pub(super) fn is_listed(&self, limits: &ConflictLimits) -> bool {
        let likely = |p: Option<f64>| p.is_some_and(|p| p >= limits.listed_p);
        self.pet_s.is_some_and(|pet| pet <= limits.pet_s)
            || self.min_ttc_s.is_some_and(|ttc| ttc <= limits.ttc_s)
            || self.max_drac_mps2.is_some_and(|drac| drac >= limits.drac_mps2)
            || likely(self.min_ttc_below_p)
            || likely(self.max_drac_above_p)
    }
}

/// Returns the probability that a quantity is below a limit. It is 0 or 1 for a quantity without an sd.
pub(super) fn below_p(value: f64, sd: Option<f64>, limit: f64) -> f64 {
    normal::positive(limit - value, sd.unwrap_or(0.0))
}
