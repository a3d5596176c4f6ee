//! The path of a vehicle as a curve over the travelled distance, and the times at which the vehicle is where on it.

use nalgebra::Vector2;

use super::footprint::Footprint;
use crate::{State, Vehicle};

/// Shortest distance between two nodes that come from states, m. Steps of a stationary vehicle are noise.
const SHORTEST_M: f64 = 0.4;
/// Longest distance between two nodes, m. It is shorter than any vehicle, so that footprints at nodes leave no gaps.
const LONGEST_M: f64 = 1.5;
/// Number of nodes in a chunk. A chunk has a bounding box.
pub(super) const CHUNK: usize = 8;

/// A point of a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Travelled distance, m.
    pub travelled_m: f64,
    /// Position of the vehicle's centre, m.
    pub centre: Vector2<f64>,
    /// Unit vector along the heading.
    pub forward: Vector2<f64>,
}

/// A rectangle along the axes of the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    low: Vector2<f64>,
    high: Vector2<f64>,
}

/// The path of a vehicle.
#[derive(Clone, Debug)]
pub(super) struct Path<'a> {
    pub vehicle: &'a Vehicle,
    pub half_m: [f64; 2],
    /// Radius of the circle around the footprint, m.
    pub radius_m: f64,
    /// Nodes in the order of travel. The vehicle reached the first `observed`, the others extend the path.
    pub nodes: Vec<Node>,
    pub observed: usize,
    /// Travelled distance of every state, m. It never decreases.
    travelled_m: Vec<f64>,
    /// Bounds of the footprints of every chunk of nodes.
    pub chunks: Vec<Bounds>,
    pub bounds: Bounds,
}

impl Bounds {
    fn around(nodes: &[Node], margin_m: f64) -> Self {
        let mut bounds =
            Self { low: Vector2::repeat(f64::INFINITY), high: Vector2::repeat(f64::NEG_INFINITY) };
        for node in nodes {
            bounds.low = bounds.low.inf(&node.centre);
            bounds.high = bounds.high.sup(&node.centre);
        }
        bounds.low.add_scalar_mut(-margin_m);
        bounds.high.add_scalar_mut(margin_m);
        bounds
    }

    /// Whether two rectangles have a common point.
    pub fn meet(&self, other: &Self) -> bool {
        self.low.x <= other.high.x
            && other.low.x <= self.high.x
            && self.low.y <= other.high.y
            && other.low.y <= self.high.y
    }
}

impl<'a> Path<'a> {
    /// Returns the path of a vehicle, `None` if a number is not finite or the vehicle has no size. The path goes on
    /// straight ahead beyond its end for `beyond_s` seconds at the highest speed of the last `beyond_s` seconds.
    pub fn new(vehicle: &'a Vehicle, beyond_s: f64) -> Option<Self> {
        let half_m = [vehicle.length_m / 2.0, vehicle.width_m / 2.0];
        let finite = |state: &State| {
            [state.time_s, state.x_m, state.y_m, state.heading_rad.into(), state.speed_mps.into()]
                .iter()
                .all(|v: &f64| v.is_finite())
        };
        let last = vehicle.states.last()?;
        if !half_m.iter().all(|half| *half > 0.0 && half.is_finite()) || !vehicle.states.iter().all(finite) {
            return None;
        }
        let (mut nodes, travelled_m) = observed_nodes(&vehicle.states);
        let observed = nodes.len();
        let speed = |state: &State| f64::from(state.speed_mps.abs());
        let late = vehicle.states.iter().rev().take_while(|state| state.time_s >= last.time_s - beyond_s);
        let beyond_m = (late.map(speed).fold(0.0, f64::max) * beyond_s).min(100.0);
        let end = nodes[observed - 1];
        let direction = if last.speed_mps < 0.0 { -end.forward } else { end.forward };
        for step in 1..=(beyond_m / LONGEST_M).ceil() as usize {
            let ahead_m = step as f64 * LONGEST_M;
            let centre = end.centre + direction * ahead_m;
            nodes.push(Node { travelled_m: end.travelled_m + ahead_m, centre, ..end });
        }
        let radius_m = half_m[0].hypot(half_m[1]);
        // A chunk includes the first node of the next one, so that it covers the segment between them.
        let chunk =
            |start: usize| Bounds::around(&nodes[start..(start + CHUNK + 1).min(nodes.len())], radius_m);
        Some(Self {
            chunks: (0..nodes.len()).step_by(CHUNK).map(chunk).collect(),
            bounds: Bounds::around(&nodes, radius_m),
            vehicle,
            half_m,
            radius_m,
            nodes,
            observed,
            travelled_m,
        })
    }

    /// Returns the footprint at a node.
    pub fn at_node(&self, node: usize) -> Footprint {
        let Node { centre, forward, .. } = self.nodes[node];
        Footprint { centre, forward, half_m: self.half_m }
    }

    /// Returns the footprint at the begin of the segment after a node, with the mean heading of the segment, and the
    /// motion along the segment, m. The motion after the last node is zero.
    pub fn segment(&self, node: usize) -> (Footprint, Vector2<f64>) {
        let (from, to) = (self.nodes[node], self.nodes[(node + 1).min(self.nodes.len() - 1)]);
        let forward = (from.forward + to.forward).try_normalize(1e-9).unwrap_or(from.forward);
        (Footprint { centre: from.centre, forward, half_m: self.half_m }, to.centre - from.centre)
    }

    /// Returns the travelled distance at a share of the segment after a node, m.
    pub fn on_segment_m(&self, node: usize, share: f64) -> f64 {
        let (from, to) = (self.nodes[node], self.nodes[(node + 1).min(self.nodes.len() - 1)]);
        from.travelled_m + (to.travelled_m - from.travelled_m) * share
    }

    /// Returns the footprint after a travelled distance (m). Beyond its nodes, the path is straight.
    pub fn at(&self, travelled_m: f64) -> Footprint {
        let next = self.nodes.partition_point(|node| node.travelled_m < travelled_m);
        let later = next.clamp(1, self.nodes.len().max(2) - 1);
        if later >= self.nodes.len() {
            let node = self.nodes[0];
            let ahead_m = travelled_m - node.travelled_m;
            return Footprint {
                centre: node.centre + node.forward * ahead_m,
                forward: node.forward,
                half_m: self.half_m,
            };
        }
        let (a, b) = (self.nodes[later - 1], self.nodes[later]);
        let share = (travelled_m - a.travelled_m) / (b.travelled_m - a.travelled_m);
        let turn = a.forward.lerp(&b.forward, share.clamp(0.0, 1.0));
        Footprint {
            centre: a.centre.lerp(&b.centre, share),
            forward: turn.try_normalize(1e-9).unwrap_or(a.forward),
            half_m: self.half_m,
        }
    }

    /// Returns the first time at which the vehicle has travelled a distance (m), s.
    pub fn first_s(&self, travelled_m: f64) -> f64 {
        self.time_s(self.travelled_m.partition_point(|m| *m < travelled_m), travelled_m)
    }

    /// Returns the last time at which the vehicle has travelled at most a distance (m), s.
    pub fn last_s(&self, travelled_m: f64) -> f64 {
        self.time_s(self.travelled_m.partition_point(|m| *m <= travelled_m), travelled_m)
    }

    /// Interpolates between the state `next` and the one before it.
    fn time_s(&self, next: usize, travelled_m: f64) -> f64 {
        let states = &self.vehicle.states;
        if next == 0 || next == states.len() {
            return states[next.min(states.len() - 1)].time_s;
        }
        let (a, b) = (self.travelled_m[next - 1], self.travelled_m[next]);
        let share = if b > a { (travelled_m - a) / (b - a) } else { 1.0 };
        states[next - 1].time_s + (states[next].time_s - states[next - 1].time_s) * share
    }

    /// Returns the state at a time (s) and the travelled distance (m). `next` is a state at or after the time, or the
    /// first state; it is moved on. `None` outside the track and in gaps.
    pub fn state_at(&self, time_s: f64, next: &mut usize) -> Option<(State, f64)> {
        let states = &self.vehicle.states;
        while states.get(*next)?.time_s < time_s {
            *next += 1;
        }
        let later = &states[*next];
        if later.time_s == time_s {
            return Some((*later, self.travelled_m[*next]));
        }
        let earlier = &states[next.checked_sub(1)?];
        let share = (time_s - earlier.time_s) / (later.time_s - earlier.time_s);
        let [a, b] = [self.travelled_m[*next - 1], self.travelled_m[*next]];
        earlier.leads_to(later).then(|| (earlier.between(later, share), a + (b - a) * share))
    }
}

/// Returns the nodes of a path, and the travelled distance of each state, m. Nodes are at states that are at least
/// [`SHORTEST_M`] apart, and between them if they are more than [`LONGEST_M`] apart.
fn observed_nodes(states: &[State]) -> (Vec<Node>, Vec<f64>) {
    let node = |state: &State, travelled_m: f64| Node {
        travelled_m,
        centre: state.position(),
        forward: state.forward(),
    };
    let mut nodes = vec![node(&states[0], 0.0)];
    let mut travelled_m: Vec<f64> = vec![0.0];
    let mut kept = 0;
    for i in 1..states.len() {
        let (from, to) = (&states[kept], &states[i]);
        let step_m = (to.position() - from.position()).norm();
        if step_m < SHORTEST_M && i + 1 < states.len() || step_m < 1e-6 {
            continue;
        }
        let start_m = travelled_m[kept];
        // States between the two nodes: their progress towards the later node.
        let direction = (to.position() - from.position()) / step_m;
        for between in &states[kept + 1..i] {
            let progress_m = (between.position() - from.position()).dot(&direction).clamp(0.0, step_m);
            let before_m = travelled_m[travelled_m.len() - 1];
            travelled_m.push(before_m.max(start_m + progress_m));
        }
        travelled_m.push(start_m + step_m);
        let parts = (step_m / LONGEST_M).ceil().clamp(1.0, 1e4) as usize;
        for part in 1..=parts {
            let share = part as f64 / parts as f64;
            nodes.push(node(&from.between(to, share), start_m + step_m * share));
        }
        kept = i;
    }
    travelled_m.resize(states.len(), travelled_m[kept]);
    (nodes, travelled_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vehicle(positions_m: &[f64]) -> Vehicle {
        let states = positions_m.iter().enumerate().map(|(i, x)| State {
            time_s: i as f64,
            x_m: *x,
            speed_mps: 10.0,
            ..State::default()
        });
        Vehicle {
            track: 1,
            class: roadplane_base::VehicleClass::Car,
            length_m: 4.0,
            width_m: 2.0,
            length_sd_m: 0.0,
            exists_p: 1.0,
            states: states.collect(),
        }
    }

    #[test]
    fn times_of_a_vehicle_that_stops_with_jitter() {
        let vehicle = vehicle(&[0.0, 10.0, 10.1, 9.95, 10.05, 20.0]);
        let path = Path::new(&vehicle, 2.0).unwrap();
        assert!((path.first_s(5.0) - 0.5).abs() < 1e-9);
        assert!((path.first_s(10.0) - 1.0).abs() < 1e-9);
        assert!((path.last_s(10.1) - 4.0).abs() < 0.05, "{}", path.last_s(10.1));
        assert!((path.last_s(15.0) - 4.5).abs() < 0.01);
        assert_eq!((path.first_s(-1.0), path.last_s(99.0)), (0.0, 5.0));
        assert!((path.at(12.0).centre.x - 12.0).abs() < 1e-9);
        assert!((path.at(25.0).centre.x - 25.0).abs() < 1e-9, "straight on beyond the end");
        assert!(path.nodes.windows(2).all(|w| w[1].travelled_m - w[0].travelled_m <= LONGEST_M + 1e-9));
    }

    #[test]
    fn no_path_without_size_or_with_a_number_that_is_not_finite() {
        let good = vehicle(&[0.0, 1.0]);
        assert!(Path::new(&good, 1.0).is_some());
        assert!(Path::new(&Vehicle { width_m: 0.0, ..good.clone() }, 1.0).is_none());
        assert!(Path::new(&vehicle(&[0.0, f64::NAN]), 1.0).is_none());
        assert!(Path::new(&vehicle(&[]), 1.0).is_none());
    }
}
