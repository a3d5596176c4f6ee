//! Vehicles in a zone: visits, occupancy, density, flow and queues.

use nalgebra::Vector2;

use crate::{State, Vehicle, Zone};

/// Speed below which a vehicle counts as stationary, m/s. Source: 5 mph, Highway Capacity Manual 2016, chapter 31
/// (vehicles in a queue).
pub const STATIONARY_MPS: f64 = 2.2;

/// A stay of a vehicle in a zone.
#[derive(Clone, Debug, PartialEq)]
pub struct Visit {
    /// Index of the vehicle in the clip.
    pub vehicle: usize,
    /// Times at which the centre of the vehicle enters and leaves the zone, s. If it was not seen to do so, they are the
    /// times of its first and last state in the zone.
    pub span_s: [f64; 2],
    /// Whether the vehicle was seen to enter and to leave.
    pub seen: [bool; 2],
    /// Sd of the length of the stay from the vehicle's own position error, s.
    pub sd_s: f64,
    /// Time in which the vehicle was stationary, s.
    pub stationary_s: f64,
    /// Length of the vehicle's path in the zone, m.
    pub path_m: f64,
}

/// Returns the stays of a vehicle in a zone. `index` is the index of the vehicle in the clip.
#[must_use]
pub fn visits(zone: &Zone, index: usize, vehicle: &Vehicle) -> Vec<Visit> {
    let mut found: Vec<Visit> = Vec::new();
    let Some(first) = vehicle.states.first() else { return found };
    let mut open = zone.contains(&first.position()).then(|| Visit::begun(index, first, false));
    for (a, b) in vehicle.states.iter().zip(vehicle.states.iter().skip(1)) {
        let (was, is) = (open.is_some(), zone.contains(&b.position()));
        let share = if was == is { 1.0 } else { border(zone, a, b) };
        let at = a.between(b, share);
        match (&mut open, is) {
            (None, true) => {
                let mut visit = Visit::begun(index, &at, true);
                visit.go_on(&at, b);
                open = Some(visit);
            }
            (Some(visit), _) => {
                visit.go_on(a, &at);
                if !is {
                    visit.seen[1] = true;
                    visit.sd_s = visit.sd_s.hypot(at.passing_sd_s(&at.forward()));
                    found.extend(open.take());
                }
            }
            (None, false) => {}
        }
    }
    found.extend(open);
    // A vehicle that trembles on the border makes stays that are shorter than the error of their length.
    found.retain(|visit| visit.span_s[1] - visit.span_s[0] > visit.sd_s);
    found
}

impl Visit {
    fn begun(vehicle: usize, at: &State, seen: bool) -> Self {
        Self {
            vehicle,
            span_s: [at.time_s; 2],
            seen: [seen, false],
            sd_s: if seen { at.passing_sd_s(&at.forward()) } else { 0.0 },
            stationary_s: 0.0,
            path_m: 0.0,
        }
    }

    fn go_on(&mut self, a: &State, b: &State) {
        self.span_s[1] = b.time_s;
        self.path_m += (b.position() - a.position()).norm();
        let mean_mps = f64::from(a.speed_mps.abs() + b.speed_mps.abs()) / 2.0;
        if mean_mps < STATIONARY_MPS {
            self.stationary_s += b.time_s - a.time_s;
        }
    }

    /// Returns the length of the stay, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.span_s[1] - self.span_s[0]
    }

    /// Returns the part of the stay between two times, s.
    #[must_use]
    pub fn within_s(&self, from_s: f64, to_s: f64) -> f64 {
        (self.span_s[1].min(to_s) - self.span_s[0].max(from_s)).max(0.0)
    }
}

/// Returns where between two states the border of the zone lies, as a share, by bisection.
fn border(zone: &Zone, a: &State, b: &State) -> f64 {
    let starts_inside = zone.contains(&a.position());
    let (mut low, mut high) = (0.0, 1.0);
    // 20 halvings of a step of a metre leave a micrometre.
    for _ in 0..20 {
        let middle = (low + high) / 2.0;
        if zone.contains(&(a.position() + (b.position() - a.position()) * middle)) == starts_inside {
            low = middle;
        } else {
            high = middle;
        }
    }
    (low + high) / 2.0
}

/// A queue in a zone at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Queue {
    /// Number of stationary vehicles in the zone.
    pub vehicles: usize,
    /// Distance from the foremost front to the hindmost rear along the direction of the queue, m.
    pub length_m: f64,
}

/// Returns the stationary vehicles among those that are in a zone at a time, as a queue.
#[must_use]
pub fn queue(states: &[(&Vehicle, State)]) -> Queue {
    let stationary: Vec<_> =
        states.iter().filter(|(_, s)| f64::from(s.speed_mps).abs() < STATIONARY_MPS).collect();
    let forward: Vector2<f64> = stationary.iter().map(|(_, s)| s.forward()).sum();
    let forward = forward.try_normalize(1e-9).unwrap_or_default();
    let ends = stationary.iter().flat_map(|(vehicle, s)| {
        let half = s.forward() * vehicle.length_m / 2.0;
        [s.position() + half, s.position() - half].map(|end| end.dot(&forward))
    });
    let (low, high) =
        ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    Queue { vehicles: stationary.len(), length_m: (high - low).max(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zone() -> Zone {
        let outline = [[0.0, -5.0], [20.0, -5.0], [20.0, 5.0], [0.0, 5.0]];
        Zone { name: "z".to_owned(), outline: outline.map(|[x, y]| Vector2::new(x, y)).to_vec() }
    }

    /// A vehicle along x with the given positions, one each second, with the speeds between them.
    fn vehicle(xs: &[f64]) -> Vehicle {
        let state = |(i, &x_m): (usize, &f64)| {
            let next = xs.get(i + 1).copied().unwrap_or(x_m);
            State { time_s: i as f64, x_m, speed_mps: (next - x_m) as f32, ..State::default() }
        };
        Vehicle::car(xs.iter().enumerate().map(state).collect())
    }

    #[test]
    fn a_stay_has_its_times_path_and_stop() {
        let xs = [-10.0, -2.0, 6.0, 10.0, 10.0, 10.0, 14.0, 22.0, 30.0];
        let found = visits(&zone(), 3, &vehicle(&xs));
        let [visit] = found.as_slice() else { panic!("{found:?}") };
        assert!((visit.span_s[0] - 1.25).abs() < 1e-5 && (visit.span_s[1] - 6.75).abs() < 1e-5);
        assert_eq!((visit.vehicle, visit.seen), (3, [true, true]));
        assert!((visit.path_m - 20.0).abs() < 1e-4);
        assert!((visit.stationary_s - 2.0).abs() < 1.01, "{visit:?}");
        assert!((visit.within_s(3.0, 4.0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_parked_vehicle_is_not_seen_to_enter() {
        let found = visits(&zone(), 0, &vehicle(&[5.0; 4]));
        assert_eq!((found[0].seen, found[0].time_s(), found[0].stationary_s), ([false, false], 3.0, 3.0));
    }

    #[test]
    fn a_queue_reaches_from_the_first_front_to_the_last_rear() {
        let parked = vehicle(&[5.0; 2]);
        let at = |x_m: f64, speed_mps: f32| State { x_m, speed_mps, ..State::default() };
        let queue = queue(&[(&parked, at(5.0, 0.0)), (&parked, at(12.0, 1.0)), (&parked, at(30.0, 9.0))]);
        assert_eq!(queue, Queue { vehicles: 2, length_m: 11.0 });
    }
}
