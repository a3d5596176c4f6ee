//! Crossings of a gate: which vehicle crosses, when, how fast, and with which probability.
//!
//! A vehicle crosses a gate when the centre of its footprint changes the side. Its position has an error, so each
//! crossing has a probability: the product of three normal probabilities. The vehicle was on the first side before, it
//! was on the other side afterwards, and it passed between the ends of the gate. Passages just outside of the ends, and
//! paths that end just before the gate, are crossings with a small probability.

use nalgebra::Vector2;

use crate::normal::positive;
use crate::{Direction, Gate, State, Vehicle};

/// A vehicle that crosses a gate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Index of the vehicle in the clip.
    pub vehicle: usize,
    /// Side to which the vehicle crosses.
    pub direction: Direction,
    /// Time at which the centre of the vehicle is on the line, s.
    pub time_s: f64,
    /// Times at which the front and the rear of the vehicle are on the line, s, in the order of time.
    pub ends_s: [f64; 2],
    /// Sd of `time_s` from the vehicle's own position error, s.
    pub time_sd_s: f64,
    /// Sd of `ends_s` from the vehicle's own position error and the error of its length, s.
    pub ends_sd_s: f64,
    /// State of the vehicle at `time_s`.
    pub state: State,
    /// Place of the crossing along the gate, from its first point, m.
    pub along_m: f64,
    depths: Depths,
}

/// Distances that decide whether a vehicle crossed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Depths {
    /// Largest distance from the line on the side from which the vehicle comes, m, and its sd.
    before_m: [f64; 2],
    /// Largest distance from the line on the other side, m, and its sd. It is negative if the path ends before the line.
    after_m: [f64; 2],
    /// Distances inside the two ends of the gate, m, and their sd.
    inside_m: [f64; 2],
    inside_sd_m: f64,
}

/// Number of sds within which a path that misses a gate can still be a crossing. The probability beyond is below 0.2 %.
const NEAR_SDS: f64 = 3.0;
/// A crossing that is undone needs at least this probability, so that an error of position does not count as two
/// crossings.
const LEAST_RETURN_P: f64 = 0.975;

impl Crossing {
    /// Returns the probability of the crossing, for a gate that is displaced by `ahead_m` in the direction of the
    /// crossing and by `along_m` along its line. The vehicle itself exists.
    #[must_use]
    pub fn probability(&self, ahead_m: f64, along_m: f64) -> f64 {
        let d = &self.depths;
        let [from_first, from_last] = d.inside_m;
        let within = positive(from_first - along_m, d.inside_sd_m)
            + positive(from_last + along_m, d.inside_sd_m)
            - 1.0;
        positive(d.before_m[0] + ahead_m, d.before_m[1])
            * positive(d.after_m[0] - ahead_m, d.after_m[1])
            * within.max(0.0)
    }
}

/// Returns the crossings of a gate by one vehicle in the order of time. `vehicle` is its index in the clip.
#[must_use]
pub fn crossings(gate: &Gate, index: usize, vehicle: &Vehicle) -> Vec<Crossing> {
    let line = Line::new(gate, vehicle);
    let mut found: Vec<Crossing> = Vec::new();
    for (a, b) in vehicle.steps() {
        found.extend(line.crossed(index, vehicle, a, b));
    }
    found.extend(line.beyond_path(index, vehicle));
    found.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let measure = |found: &mut [Crossing]| {
        let times: Vec<f64> = found.iter().map(|crossing| crossing.time_s).collect();
        for (i, crossing) in found.iter_mut().enumerate() {
            let from_s = if i == 0 { f64::NEG_INFINITY } else { times[i - 1] };
            let to_s = times.get(i + 1).copied().unwrap_or(f64::INFINITY);
            line.measure_depths(vehicle, crossing, from_s, to_s);
        }
    };
    measure(&mut found);
    let mut kept = without_jitter(found);
    measure(&mut kept);
    kept
}

/// Removes pairs of opposite crossings between which the vehicle was hardly on the other side.
fn without_jitter(found: Vec<Crossing>) -> Vec<Crossing> {
    let mut kept: Vec<Crossing> = Vec::new();
    for crossing in found {
        let undoes = kept.last().is_some_and(|last| {
            let [depth, sd] = crossing.depths.before_m;
            last.direction != crossing.direction && positive(depth, sd) < LEAST_RETURN_P
        });
        if undoes {
            kept.pop();
        } else {
            kept.push(crossing);
        }
    }
    kept
}

/// The line of a gate, with its ends prolonged for vehicles that pass near them.
struct Line {
    points: Vec<Vector2<f64>>,
    /// Distance of each point from the gate's first point along the line, m; negative in the prolongation.
    along_m: Vec<f64>,
    length_m: f64,
}

impl Line {
    fn new(gate: &Gate, vehicle: &Vehicle) -> Self {
        let sd = vehicle.states.iter().flat_map(|s| s.own_sd_m).fold(0.0_f32, f32::max);
        let beyond = NEAR_SDS * f64::from(sd).hypot(gate.shared_sd_m);
        let mut points = gate.line.clone();
        let last = points.len() - 1;
        let outward =
            |from: Vector2<f64>, to: Vector2<f64>| (to - from).try_normalize(0.0).unwrap_or_default();
        let (first_end, last_end) =
            (outward(gate.line[1], gate.line[0]), outward(gate.line[last - 1], gate.line[last]));
        points[0] += first_end * beyond;
        points[last] += last_end * beyond;
        let mut along_m = vec![-beyond];
        for pair in points.windows(2) {
            along_m.push(along_m[along_m.len() - 1] + (pair[1] - pair[0]).norm());
        }
        let length_m = along_m[last] - beyond;
        Self { points, along_m, length_m }
    }

    /// Returns the crossing between two states, if there is one.
    fn crossed(&self, index: usize, vehicle: &Vehicle, a: &State, b: &State) -> Option<Crossing> {
        let (share, along_m, part) = self.cut(&a.position(), &b.position())?;
        let state = a.between(b, share);
        Some(self.crossing(index, vehicle, state, b.position() - a.position(), along_m, part))
    }

    /// Returns where a path between two points cuts the line: the share of the path, the distance along the line, and the
    /// index of the line's part.
    fn cut(&self, from: &Vector2<f64>, to: &Vector2<f64>) -> Option<(f64, f64, usize)> {
        let step = to - from;
        let mut cuts = self.points.windows(2).enumerate().filter_map(|(i, pair)| {
            let part = pair[1] - pair[0];
            let side = |p: &Vector2<f64>| part.perp(&(p - pair[0]));
            let (a, b) = (side(from), side(to));
            // A point on the line belongs to the left side, so that each passage counts once.
            if (a >= 0.0) == (b >= 0.0) {
                return None;
            }
            let share = a / (a - b);
            let place = part.dot(&(from + step * share - pair[0])) / part.norm_squared();
            (0.0..1.0).contains(&place).then(|| (share, self.along_m[i] + place * part.norm(), i))
        });
        cuts.next()
    }

    fn crossing(
        &self,
        vehicle: usize,
        body: &Vehicle,
        state: State,
        motion: Vector2<f64>,
        along_m: f64,
        part: usize,
    ) -> Crossing {
        let tangent = (self.points[part + 1] - self.points[part]).try_normalize(0.0).unwrap_or_default();
        let right = Vector2::new(tangent.y, -tangent.x);
        let direction = if motion.dot(&right) > 0.0 { Direction::Forward } else { Direction::Backward };
        let ahead = if direction == Direction::Forward { right } else { -right };
        let speed_mps = state.speed_along(&ahead);
        let time_sd_s = state.passing_sd_s(&ahead);
        Crossing {
            vehicle,
            direction,
            time_s: state.time_s,
            ends_s: self.ends_at(body, state.time_s, speed_mps),
            time_sd_s,
            ends_sd_s: time_sd_s.hypot(body.length_sd_m / 2.0 / speed_mps),
            state,
            along_m,
            depths: Depths {
                before_m: [0.0; 2],
                after_m: [0.0; 2],
                inside_m: [along_m, self.length_m - along_m],
                inside_sd_m: state.own_variance_along(&tangent).sqrt(),
            },
        }
    }

    /// Returns the times at which front and rear are on the line. Where the path does not show this, the speed at the
    /// line gives the time.
    fn ends_at(&self, vehicle: &Vehicle, time_s: f64, speed_across: f64) -> [f64; 2] {
        let half = vehicle.length_m / 2.0;
        let by_speed = half / speed_across;
        let end = |offset: f64, expected: f64| {
            let cuts = vehicle.steps().filter_map(|(a, b)| {
                let from = a.position() + a.forward() * offset;
                let to = b.position() + b.forward() * offset;
                let (share, _, _) = self.cut(&from, &to)?;
                Some(a.time_s + (b.time_s - a.time_s) * share)
            });
            cuts.min_by(|x, y| (x - time_s).abs().total_cmp(&(y - time_s).abs())).unwrap_or(expected)
        };
        let mut ends = [end(half, time_s - by_speed), end(-half, time_s + by_speed)];
        ends.sort_by(f64::total_cmp);
        ends
    }

    /// Returns possible crossings before the first state and after the last state, for a path that begins just behind the
    /// line or ends just before it.
    fn beyond_path(&self, index: usize, vehicle: &Vehicle) -> impl Iterator<Item = Crossing> {
        let ends = [(vehicle.states.first(), -1.0), (vehicle.states.last(), 1.0)];
        ends.into_iter().filter_map(move |(state, sign)| {
            let state = *state.filter(|state| state.speed_mps != 0.0)?;
            let motion = state.forward() * f64::from(state.speed_mps).signum();
            let reach = NEAR_SDS * f64::from(state.own_sd_m[0].max(state.own_sd_m[1]));
            let beyond = state.position() + motion * reach * sign;
            let (_, along_m, part) = self.cut(&state.position(), &beyond)?;
            Some(self.crossing(index, vehicle, state, motion, along_m, part))
        })
    }

    /// Measures how far the vehicle was on either side of the line between the crossings before and after this one.
    fn measure_depths(&self, vehicle: &Vehicle, crossing: &mut Crossing, from_s: f64, to_s: f64) {
        let states = &vehicle.states;
        let span = |from: f64, to: f64| {
            let first = states.partition_point(|s| s.time_s < from);
            let end = states.partition_point(|s| s.time_s <= to);
            &states[first.min(end)..end]
        };
        let sign = if crossing.direction == Direction::Forward { 1.0 } else { -1.0 };
        let deepest = |states: &[State], sign: f64| {
            let depth = |s: &State| {
                let (signed, right) = self.right_of(&s.position());
                [signed * sign, s.own_variance_along(&right).sqrt()]
            };
            states.iter().map(depth).max_by(|a, b| a[0].total_cmp(&b[0])).unwrap_or([0.0, 0.0])
        };
        crossing.depths.before_m = deepest(span(from_s, crossing.time_s), -sign);
        crossing.depths.after_m = deepest(span(crossing.time_s, to_s), sign);
    }

    /// Returns the distance of a point to the right of the line, m, and the unit vector to the right.
    fn right_of(&self, point: &Vector2<f64>) -> (f64, Vector2<f64>) {
        let nearest = self.points.windows(2).map(|pair| {
            let part = pair[1] - pair[0];
            let place = (part.dot(&(point - pair[0])) / part.norm_squared()).clamp(0.0, 1.0);
            let away = point - (pair[0] + part * place);
            let right = Vector2::new(part.y, -part.x) / part.norm();
            (away.norm(), away.dot(&right), right)
        });
        let (distance, signed, right) =
            nearest.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, 0.0, Vector2::x()));
        (distance.copysign(signed), right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gate() -> Gate {
        Gate {
            name: "a".to_owned(),
            line: vec![Vector2::new(0.0, -5.0), Vector2::new(0.0, 5.0)],
            shared_sd_m: 0.0,
        }
    }

    /// A vehicle on the x axis that is at each x at each tenth of a second.
    fn vehicle(xs: &[f64], y_m: f64, sd: f32) -> Vehicle {
        let state = |(i, &x_m): (usize, &f64)| State {
            time_s: i as f64 / 10.0,
            x_m,
            y_m,
            speed_mps: 10.0,
            own_sd_m: [sd; 2],
            ..State::default()
        };
        Vehicle::car(xs.iter().enumerate().map(state).collect())
    }

    fn drive(from: f64, to: f64) -> Vec<f64> {
        let steps = (to - from).abs().round() as i32;
        (0..=steps).map(|i| from + f64::from(i) * (to - from).signum()).collect()
    }

    #[test]
    fn a_passage_has_its_time_direction_and_ends() {
        let found = crossings(&gate(), 7, &vehicle(&drive(-9.5, 9.5), 0.0, 0.1));
        let [crossing] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!((crossing.vehicle, crossing.direction), (7, Direction::Forward));
        assert!((crossing.time_s - 0.95).abs() < 1e-9 && (crossing.along_m - 5.0).abs() < 1e-9);
        assert!((crossing.ends_s[0] - 0.75).abs() < 1e-6 && (crossing.ends_s[1] - 1.15).abs() < 1e-6);
        assert!((crossing.time_sd_s - 0.01).abs() < 1e-6);
        assert!(crossing.probability(0.0, 0.0) > 0.999_999);
        let back = crossings(&gate(), 0, &vehicle(&drive(9.5, -9.5), 0.0, 0.1));
        assert_eq!(back[0].direction, Direction::Backward);
    }

    #[test]
    fn a_passage_at_the_end_of_the_gate_is_half_a_crossing() {
        for (y, p) in [(5.0, 0.5), (4.8, 0.841), (5.2, 0.159), (-5.2, 0.159), (6.0, 0.0)] {
            let found = crossings(&gate(), 0, &vehicle(&drive(-9.5, 9.5), y, 0.2));
            let sum: f64 = found.iter().map(|crossing| crossing.probability(0.0, 0.0)).sum();
            assert!((sum - p).abs() < 0.002, "{y}: {sum}");
        }
        let exact = crossings(&gate(), 0, &vehicle(&drive(-9.5, 9.5), 5.2, 0.0));
        assert!(exact.is_empty());
    }

    #[test]
    fn a_path_that_ends_at_the_line_is_half_a_crossing() {
        for (end, p) in [(0.001, 0.5), (0.2, 0.841), (-0.2, 0.159), (-1.0, 0.0)] {
            let mut xs = drive(-9.5, -1.5);
            xs.push(end);
            let mut later: Vec<f64> = xs.iter().map(|x| -x).collect();
            later.reverse();
            for xs in [xs, later] {
                let found = crossings(&gate(), 0, &vehicle(&xs, 0.0, 0.2));
                let sum: f64 = found.iter().map(|crossing| crossing.probability(0.0, 0.0)).sum();
                assert!((sum - p).abs() < 0.005, "{end}: {sum}");
            }
        }
    }

    #[test]
    fn a_vehicle_that_trembles_on_the_line_crosses_once() {
        let mut xs = drive(-9.5, -0.5);
        xs.extend([0.05, -0.04, 0.03, -0.05, 0.02]);
        xs.extend(drive(0.5, 9.5));
        let found = crossings(&gate(), 0, &vehicle(&xs, 0.0, 0.2));
        assert_eq!(found.len(), 1);
        assert!(found[0].probability(0.0, 0.0) > 0.999, "it certainly crossed: {found:?}");
        // A vehicle that turns back far beyond the line crosses twice.
        let mut xs = drive(-9.5, 5.5);
        xs.extend(drive(4.5, -9.5));
        let found = crossings(&gate(), 0, &vehicle(&xs, 0.0, 0.2));
        assert_eq!(
            found.iter().map(|c| c.direction).collect::<Vec<_>>(),
            [Direction::Forward, Direction::Backward]
        );
    }

    #[test]
    fn a_displaced_gate_changes_the_probability_of_passages_near_its_end() {
        let found = crossings(&Gate { shared_sd_m: 0.5, ..gate() }, 0, &vehicle(&drive(-9.5, 9.5), 5.2, 0.1));
        let p = |along_m| found[0].probability(0.0, along_m);
        assert!(p(0.0) < 0.03 && p(0.5) > 0.99 && p(-0.5) < 1e-6);
    }
}
