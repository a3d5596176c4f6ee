//! The true activities of the cars of a clip.

use std::collections::BTreeMap;
use std::ops::Range;

use roadplane_activity::{Label, event_spans, label_spans};
use roadplane_base::angle_difference;

use super::events::TrueEvent;
use roadplane_metrics::scoring::counts;
use roadplane_metrics::truth::{TrueCar, Truth};

/// Least length of an interval that must be found as an event, s.
const LEAST_EVENT_S: f64 = 0.5;

/// Returns whether a car is scored in a frame: it is large enough, and enough of it is visible.
pub fn car_counts(truth: &Truth, car: &TrueCar) -> bool {
    truth.model(car.id).is_some_and(|model| counts(car, model))
}

/// Returns the observations of each car in order of time, by the id of the car.
pub fn cars_by_id(truth: &Truth) -> BTreeMap<u64, Vec<Seen<'_>>> {
    let mut cars: BTreeMap<u64, Vec<Seen<'_>>> = BTreeMap::new();
    for frame in &truth.frames {
        for car in &frame.cars {
            cars.entry(car.id).or_default().push((frame.frame, frame.time_s, car));
        }
    }
    cars
}

/// Returns the true heading of a car in the world frame, rad.
pub fn heading_of(car: &TrueCar) -> f64 {
    car.world_from_car[1][0].atan2(car.world_from_car[0][0])
}

/// Returns the right labels of each car in each frame, by id of the car and index of the frame.
///
/// The first label is the car's true label in that frame. Labels that the car has within `fuzzy_s` (s) follow.
pub fn true_labels(truth: &Truth, fuzzy_s: f64) -> BTreeMap<(u64, u64), Vec<Label>> {
    let mut labels = BTreeMap::new();
    for (id, cars) in cars_by_id(truth) {
        let own: Vec<Label> = (0..cars.len())
            .map(|i| {
                let (_, _, car) = cars[i];
                let (before, after) = (&cars[i.saturating_sub(1)], &cars[(i + 1).min(cars.len() - 1)]);
                let turned = angle_difference(heading_of(after.2), heading_of(before.2));
                let path_m = (after.1 - before.1) * car.speed_mps;
                let curvature = if path_m.abs() > 1e-3 { turned / path_m } else { 0.0 };
                Label::of_truth(car.activity, car.speed_mps, curvature)
            })
            .collect();
        for (i, (frame, time_s, _)) in cars.iter().enumerate() {
            let mut right = vec![own[i]];
            let near = |j: &usize| (cars[*j].1 - time_s).abs() <= fuzzy_s;
            let around = (0..i).rev().take_while(near).chain((i..cars.len()).take_while(near));
            right.extend(around.map(|j| own[j]).filter(|label| *label != own[i]));
            right.dedup();
            labels.insert((id, *frame), right);
        }
    }
    labels
}

/// Returns the intervals in which a moving car is visible in every frame and has one label.
///
/// An interval must be found if the car is scored in most of the interval's frames and the interval is long enough.
pub fn true_intervals(truth: &Truth, labels: &BTreeMap<(u64, u64), Vec<Label>>) -> Vec<TrueEvent> {
    while_seen(truth, labels, |named, _| label_spans(named))
}

/// Returns the [`true_intervals`], and in addition the starts and stops that happen during turns.
pub fn true_events(truth: &Truth, labels: &BTreeMap<(u64, u64), Vec<Label>>) -> Vec<TrueEvent> {
    while_seen(truth, labels, |named, seen| {
        let time_s: Vec<f64> = seen.iter().map(|(_, time_s, _)| *time_s).collect();
        let speed_mps: Vec<f64> = seen.iter().map(|(_, _, car)| car.speed_mps).collect();
        event_spans(named, &time_s, &speed_mps)
    })
}

/// A car in a frame: the frame's index, the frame's time (s), and the car.
type Seen<'a> = (u64, f64, &'a TrueCar);

/// Returns the events of each car. A frame without the car separates events.
///
/// `spans` returns the events of a list of labels, one label per frame, as ranges of that list.
fn while_seen(
    truth: &Truth,
    labels: &BTreeMap<(u64, u64), Vec<Label>>,
    spans: impl Fn(&[Label], &[Seen<'_>]) -> Vec<(Label, Range<usize>)>,
) -> Vec<TrueEvent> {
    let mut events = Vec::new();
    for (id, cars) in cars_by_id(truth) {
        let label = |frame: u64| labels.get(&(id, frame)).map_or(Label::NotMoving, |right| right[0]);
        for seen in cars.chunk_by(|a, b| b.0 == a.0 + 1) {
            let named: Vec<Label> = seen.iter().map(|(frame, _, _)| label(*frame)).collect();
            events.extend(spans(&named, seen).into_iter().map(|(label, span)| {
                let part = &seen[span];
                let counted = part.iter().filter(|(_, _, car)| car_counts(truth, car)).count();
                let span_s = [part[0].1, part[part.len() - 1].1];
                let counts = 2 * counted > part.len() && span_s[1] - span_s[0] >= LEAST_EVENT_S;
                TrueEvent { car: id, label, span_s, counts }
            }));
        }
    }
    events
}
