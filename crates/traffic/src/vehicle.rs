//! The input of all traffic figures: vehicles with their paths on the ground.

use nalgebra::Vector2;
use roadplane_base::VehicleClass;

/// The vehicles of one clip in one world frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Name of the clip.
    pub name: String,
    /// Time of the clip's first frame, s since 1970-01-01 00:00 UTC; `None` if it is unknown.
    pub start_s: Option<f64>,
    /// Presentation times of the first and the last frame, s.
    pub span_s: [f64; 2],
    /// Intervals within the span in which vehicles could not be followed, s. They are sorted and do not overlap.
    pub not_followed_s: Vec<[f64; 2]>,
    /// Relative sd of all lengths and speeds. All vehicles of the clip share this error of the metric scale. `None` if
    /// the tracks have no sds.
    pub scale_sd: Option<f64>,
    /// The vehicles, sorted by track number.
    pub vehicles: Vec<Vehicle>,
}

/// A vehicle and its path on the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Vehicle {
    /// Number of the track.
    pub track: u64,
    /// Class of the vehicle.
    pub class: VehicleClass,
    /// Length of the vehicle, m.
    pub length_m: f64,
    /// Sd of the length, m; 0 if unknown.
    pub length_sd_m: f64,
    /// Width of the vehicle without mirrors, m.
    pub width_m: f64,
    /// Probability that the vehicle exists, 0 to 1.
    pub exists_p: f64,
    /// States of the vehicle in the order of time. The list is never empty.
    pub states: Vec<State>,
}

/// The state of a vehicle at one time. The position is the centre of its footprint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Presentation time, s.
    pub time_s: f64,
    /// World x, m.
    pub x_m: f64,
    /// World y, m.
    pub y_m: f64,
    /// Heading, rad: 0 along world +x, counter-clockwise.
    pub heading_rad: f32,
    /// Speed along the heading, m/s. It is negative if the vehicle reverses.
    pub speed_mps: f32,
    /// Sds of x and y without the error that all vehicles share, m; 0 if unknown.
    pub own_sd_m: [f32; 2],
    /// Sd of the speed without the error that all vehicles share, m/s; 0 if unknown.
    pub own_speed_sd_mps: f32,
    /// Relative sd of the metric scale at this place along the heading; 0 if unknown. All vehicles share this error.
    pub scale_sd: f32,
}

/// Longest time between two states of a moving vehicle that is bridged by interpolation, s. Such a vehicle has a row in
/// every frame, except while it is out of the picture.
const LONGEST_STEP_S: f64 = 1.1;

impl Clip {
    /// Returns the time in which vehicles were followed between two times, s.
    #[must_use]
    pub fn followed_s(&self, from_s: f64, to_s: f64) -> f64 {
        let overlap = |[from, to]: [f64; 2]| (to.min(to_s) - from.max(from_s)).max(0.0);
        let lost: f64 = self
            .not_followed_s
            .iter()
            .map(|&[from, to]| overlap([from.max(self.span_s[0]), to.min(self.span_s[1])]))
            .sum();
        overlap(self.span_s) - lost
    }
}

impl State {
    /// Returns the position, m.
    #[must_use]
    pub fn position(&self) -> Vector2<f64> {
        Vector2::new(self.x_m, self.y_m)
    }

    /// Returns the unit vector along the heading.
    #[must_use]
    pub fn forward(&self) -> Vector2<f64> {
        let (sin, cos) = f64::from(self.heading_rad).sin_cos();
        Vector2::new(cos, sin)
    }

    /// Returns the variance of the vehicle's own position error along a unit vector, m².
    #[must_use]
    pub fn own_variance_along(&self, direction: &Vector2<f64>) -> f64 {
        let [x, y] = self.own_sd_m.map(f64::from);
        (x * direction.x).powi(2) + (y * direction.y).powi(2)
    }

    /// Returns the sd of the time at which the vehicle passes a line, s. `across` is the unit vector across the line.
    #[must_use]
    pub fn passing_sd_s(&self, across: &Vector2<f64>) -> f64 {
        self.own_variance_along(across).sqrt() / self.speed_along(across)
    }

    /// Returns the absolute speed along a unit vector, m/s. It is at least 0.1 m/s, so that times stay finite.
    #[must_use]
    pub fn speed_along(&self, direction: &Vector2<f64>) -> f64 {
        (f64::from(self.speed_mps) * self.forward().dot(direction)).abs().max(0.1)
    }

    /// Whether the vehicle has no gap between this state and a later one. A vehicle that rests at one place has a state at
    /// the begin and at the end of its rest only.
    #[must_use]
    pub fn leads_to(&self, later: &Self) -> bool {
        later.time_s - self.time_s <= LONGEST_STEP_S || self.rests_until(later)
    }

    /// Whether the vehicle is stationary at one place in this state and in a later one.
    #[must_use]
    pub fn rests_until(&self, later: &Self) -> bool {
        self.speed_mps == 0.0 && later.speed_mps == 0.0 && self.position() == later.position()
    }

    /// Returns the state between this state and a later one. `share` is 0 for this state and 1 for the later one.
    #[must_use]
    pub fn between(&self, later: &Self, share: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * share;
        let mix32 = |a: f32, b: f32| mix(f64::from(a), f64::from(b)) as f32;
        let turn = f64::from(later.heading_rad) - f64::from(self.heading_rad);
        let turn = turn.sin().atan2(turn.cos());
        Self {
            time_s: mix(self.time_s, later.time_s),
            x_m: mix(self.x_m, later.x_m),
            y_m: mix(self.y_m, later.y_m),
            heading_rad: (f64::from(self.heading_rad) + turn * share) as f32,
            speed_mps: mix32(self.speed_mps, later.speed_mps),
            own_sd_m: [0, 1].map(|i| mix32(self.own_sd_m[i], later.own_sd_m[i])),
            own_speed_sd_mps: mix32(self.own_speed_sd_mps, later.own_speed_sd_mps),
            scale_sd: mix32(self.scale_sd, later.scale_sd),
        }
    }
}

impl Vehicle {
    /// Returns the times of the first and the last state, s.
    #[must_use]
    pub fn span_s(&self) -> [f64; 2] {
        let time = |state: Option<&State>| state.map_or(0.0, |state| state.time_s);
        [time(self.states.first()), time(self.states.last())]
    }

    /// Returns pairs of consecutive states, without pairs that a gap separates.
    pub fn steps(&self) -> impl Iterator<Item = (&State, &State)> {
        self.states.windows(2).map(|pair| (&pair[0], &pair[1])).filter(|(a, b)| a.leads_to(b))
    }

    /// Returns the interpolated state at a time (s); `None` before the first state, after the last state, and in a gap.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<State> {
        let next = self.states.partition_point(|state| state.time_s < time_s);
        let later = self.states.get(next)?;
        if later.time_s == time_s {
            return Some(*later);
        }
        let earlier = self.states.get(next.checked_sub(1)?)?;
        let share = (time_s - earlier.time_s) / (later.time_s - earlier.time_s);
        earlier.leads_to(later).then(|| earlier.between(later, share))
    }
}

#[cfg(test)]
impl Vehicle {
    /// A car of 4 m × 2 m with these states.
    pub(crate) fn car(states: Vec<State>) -> Self {
        let class = VehicleClass::Car;
        Self { track: 1, class, length_m: 4.0, length_sd_m: 0.0, width_m: 2.0, exists_p: 1.0, states }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rest_is_no_gap_but_a_lost_vehicle_is() {
        let at = |time_s: f64, x_m: f64, speed_mps: f32| State { time_s, x_m, speed_mps, ..State::default() };
        let vehicle = Vehicle::car(vec![
            at(0.0, 5.0, 0.0),
            at(600.0, 5.0, 0.0),
            at(600.5, 6.0, 4.0),
            at(603.0, 16.0, 4.0),
        ]);
        assert_eq!(vehicle.at(300.0).map(|state| (state.x_m, state.speed_mps)), Some((5.0, 0.0)));
        assert!(vehicle.at(602.0).is_none() && vehicle.at(600.5).is_some());
        assert_eq!(vehicle.steps().count(), 2);
    }
}
