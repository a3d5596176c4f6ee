//! Where two vehicles go from a moment on, if they keep their speeds or brake.

use nalgebra::Vector2;

use super::{
    footprint::{Footprint, angle_rad},
    path::Path,
};
use crate::State;

/// Longest part of a projection in which both motions count as straight, s.
const STEP_S: f64 = 0.2;
/// Highest deceleration that is tried, m/s². Tyres reach about 10 m/s².
const HARDEST_MPS2: f64 = 20.0;
/// Number of halvings in the search for a deceleration.
const HALVINGS: usize = 16;

/// Where a vehicle is expected to go.
#[derive(Clone, Copy, Debug)]
pub(super) enum Course<'a> {
    /// Along its own path from a travelled distance, m.
    Path(&'a Path<'a>, f64),
    /// Straight on along its heading.
    Straight(Footprint),
}

/// The projected motion of a vehicle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion<'a> {
    pub course: Course<'a>,
    /// Speed along the course, m/s. It is negative only on a straight course.
    pub speed_mps: f64,
    /// Constant deceleration, m/s².
    pub brake_mps2: f64,
    /// Shift of the vehicle along its heading and to its left, m.
    pub shift_m: Vector2<f64>,
}

/// The first contact of two projected motions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    /// Time until the contact, s.
    pub after_s: f64,
    /// Angle between the headings, rad.
    pub angle_rad: f64,
    /// Place, m.
    pub place_m: Vector2<f64>,
    /// Speed of the first and the second vehicle along the axis from the first to the second, m/s.
    pub along_mps: [f64; 2],
    /// Part of the first and the second vehicle's speed that is along the axis, −1 to 1.
    pub speed_shares: [f64; 2],
    /// Length of the difference of the velocities, m/s.
    pub relative_speed_mps: f64,
    /// Directions in which an error of the first and the second vehicle's present position acts. They are the axis,
    /// turned back by the turn of the vehicle until the contact.
    pub position_axes: [Vector2<f64>; 2],
    /// Whether the second vehicle runs into the first one, and not the reverse.
    pub second_runs_in: bool,
}

/// How fast a vehicle must brake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Brake {
    /// Neither vehicle can avoid the contact by braking.
    Futile,
    /// The deceleration that avoids the contact, m/s². It is 0 if no contact is expected.
    Needed(f64),
}

impl<'a> Motion<'a> {
    /// Returns the motion along a path from a state and its travelled distance (m) on.
    pub fn along_path(path: &'a Path<'a>, (state, travelled_m): (State, f64)) -> Self {
        Self::new(Course::Path(path, travelled_m), f64::from(state.speed_mps.abs()))
    }

    /// Returns the straight motion of a vehicle from a state on.
    pub fn straight(path: &Path<'_>, (state, _): (State, f64)) -> Self {
        let footprint = Footprint { centre: state.position(), forward: state.forward(), half_m: path.half_m };
        Self::new(Course::Straight(footprint), state.speed_mps.into())
    }

    fn new(course: Course<'a>, speed_mps: f64) -> Self {
        Self { course, speed_mps, brake_mps2: 0.0, shift_m: Vector2::zeros() }
    }

    /// Returns the distance travelled after a time (s), m.
    fn travelled_m(&self, after_s: f64) -> f64 {
        if self.brake_mps2 <= 0.0 {
            return self.speed_mps * after_s;
        }
        let braked_s = after_s.min(self.speed_mps.abs() / self.brake_mps2);
        self.speed_mps.signum()
            * (self.speed_mps.abs() * braked_s - self.brake_mps2 * braked_s * braked_s / 2.0)
    }

    /// Returns the footprint after a time (s).
    pub fn after(&self, after_s: f64) -> Footprint {
        let travelled_m = self.travelled_m(after_s);
        let mut footprint = match self.course {
            Course::Path(path, start_m) => path.at(start_m + travelled_m),
            Course::Straight(start) => {
                Footprint { centre: start.centre + start.forward * travelled_m, ..start }
            }
        };
        footprint.centre += footprint.forward * self.shift_m.x + footprint.left() * self.shift_m.y;
        footprint
    }

    /// Returns the direction of travel after a time (s), per metre travelled.
    fn direction(&self, after_s: f64) -> Vector2<f64> {
        let Course::Path(path, start_m) = self.course else { return self.after(after_s).forward };
        let at_m = start_m + self.travelled_m(after_s);
        (path.at(at_m + 0.1).centre - path.at(at_m - 0.1).centre) / 0.2
    }

    fn radius_m(&self) -> f64 {
        match self.course {
            Course::Path(path, _) => path.radius_m,
            Course::Straight(start) => start.half_m[0].hypot(start.half_m[1]),
        }
    }

    /// Returns the motion with another deceleration (m/s²).
    fn braking(&self, brake_mps2: f64) -> Self {
        Self { brake_mps2, ..*self }
    }
}

/// Returns the time until the footprints of two motions touch, s. `None` if they do not touch within `horizon_s`.
pub(super) fn until_contact_s(a: &Motion<'_>, b: &Motion<'_>, horizon_s: f64) -> Option<f64> {
    let radius_m = a.radius_m() + b.radius_m();
    let fastest_mps = a.speed_mps.abs() + b.speed_mps.abs();
    let (mut now_s, mut here) = (0.0, [a.after(0.0), b.after(0.0)]);
    while now_s < horizon_s {
        let free_m = (here[1].centre - here[0].centre).norm() - radius_m;
        if free_m > fastest_mps * (horizon_s - now_s) {
            return None;
        }
        if fastest_mps == 0.0 {
            let still = Vector2::zeros();
            return here[0].touch(&still, &here[1], &still).map(|_| 0.0);
        }
        let free_s = if free_m > 0.0 { free_m / fastest_mps } else { 0.0 };
        let next_s = (now_s + free_s.max(STEP_S)).min(horizon_s);
        let there = [a.after(next_s), b.after(next_s)];
        if free_s < next_s - now_s {
            let motion = [0, 1].map(|i| there[i].centre - here[i].centre);
            let middle = [0, 1].map(|i| {
                let forward =
                    (here[i].forward + there[i].forward).try_normalize(1e-9).unwrap_or(here[i].forward);
                Footprint { forward, ..here[i] }
            });
            if let Some([from, _]) = middle[0].touch(&motion[0], &middle[1], &motion[1]) {
                return Some(now_s + from * (next_s - now_s));
            }
        }
        (now_s, here) = (next_s, there);
    }
    None
}

/// Returns the contact of two motions that happens after a time (s).
pub(super) fn contact(a: &Motion<'_>, b: &Motion<'_>, after_s: f64) -> Contact {
    let (first, second) = (a.after(after_s), b.after(after_s));
    let (axis, _) = first.separation(&second);
    let turned_back = |motion: &Motion<'_>, then: &Footprint| {
        let now = motion.after(0.0).forward;
        // The turn from the heading at the contact to the present heading, as a complex number.
        let (cos, sin) = (then.forward.dot(&now), then.forward.perp(&now));
        Vector2::new(cos * axis.x - sin * axis.y, sin * axis.x + cos * axis.y)
    };
    let apart = second.centre - first.centre;
    let directions = [a.direction(after_s), b.direction(after_s)];
    let velocities = [directions[0] * a.speed_mps, directions[1] * b.speed_mps];
    Contact {
        after_s,
        angle_rad: angle_rad(&first.forward, &second.forward),
        place_m: first.contact(&second),
        along_mps: velocities.map(|velocity| velocity.dot(&axis)),
        speed_shares: directions.map(|direction| direction.dot(&axis)),
        relative_speed_mps: (velocities[1] - velocities[0]).norm(),
        position_axes: [turned_back(a, &first), turned_back(b, &second)],
        second_runs_in: -apart.dot(&second.forward) / second.half_m[0]
            > apart.dot(&first.forward) / first.half_m[0],
    }
}

/// Returns the smallest constant deceleration of one of the vehicles with which the two do not touch within
/// `horizon_s`. The other vehicle keeps its speed.
pub(super) fn brake(a: &Motion<'_>, b: &Motion<'_>, horizon_s: f64) -> Brake {
    let Some(contact_s) = until_contact_s(a, b, horizon_s) else { return Brake::Needed(0.0) };
    if contact_s <= 0.0 {
        return Brake::Futile;
    }
    // The vehicle that runs into the other one avoids that by a stop before the place of the contact.
    let enough = |motion: &Motion<'_>| motion.speed_mps.abs() / (2.0 * contact_s) * 1.001;
    let avoided_a = |brake: f64| until_contact_s(&a.braking(brake), b, horizon_s).is_none();
    let avoided_b = |brake: f64| until_contact_s(a, &b.braking(brake), horizon_s).is_none();
    let by_b = least(enough(b), HARDEST_MPS2, avoided_b);
    let by_a = match by_b {
        Some(by_b) => least(by_b, by_b, avoided_a),
        None => least(enough(a), HARDEST_MPS2, avoided_a),
    };
    by_a.or(by_b).map_or(Brake::Futile, Brake::Needed)
}

/// Returns the smallest deceleration up to `hardest` that suffices, m/s². `None` if there is none. The search begins at
/// `guess`.
fn least(guess: f64, hardest: f64, suffices: impl Fn(f64) -> bool) -> Option<f64> {
    let (mut low, mut high) = (0.0, guess.min(hardest));
    while !suffices(high) {
        if high >= hardest || high <= 0.0 {
            return None;
        }
        (low, high) = (high, (2.0 * high).min(hardest));
    }
    for _ in 0..HALVINGS {
        let middle = (low + high) / 2.0;
        if suffices(middle) { high = middle } else { low = middle }
    }
    Some((low + high) / 2.0)
}
