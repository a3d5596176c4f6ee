//! Converts the labels of time steps to events: intervals of one label, and starts and stops within turns.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::label::Label;
use crate::motion::STEP_S;
use crate::probabilities::Probabilities;
use crate::spans::event_spans;

/// Lowest mean probability of an event. Events below this value are left out, because they are more likely wrong than
/// right.
const LEAST_CONFIDENCE: f64 = 0.5;

/// An interval of time in which a vehicle has one activity. A start or stop within a turn overlaps the turn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Number of the vehicle's track.
    pub track: u64,
    /// Activity of the vehicle.
    pub activity: Label,
    /// Beginning of the event, s.
    pub from_s: f64,
    /// End of the event, s.
    pub to_s: f64,
    /// Mean probability of the activity over the steps of the event, 0–1. For a start or stop within a turn, the
    /// probability at each step includes the probability of the turn.
    pub confidence: f64,
}

/// The labels of one track, by sample and by interval.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Labelled {
    /// Label of each sample, and the probability of this label from the net.
    pub samples: Vec<(Label, f64)>,
    /// Intervals of one label, sorted by their beginning. Each has its label, beginning (s), end (s) and mean
    /// probability.
    ///
    /// Stationary intervals are left out, and so are intervals with a mean probability below one half. Starts and stops
    /// may overlap turns.
    pub intervals: Vec<(Label, f64, f64, f64)>,
}

impl Labelled {
    /// Returns the intervals as events of the track with the given number.
    pub fn events(&self, track: u64) -> impl Iterator<Item = Event> {
        self.intervals.iter().map(move |&(activity, from_s, to_s, confidence)| Event {
            track,
            activity,
            from_s,
            to_s,
            confidence,
        })
    }
}

/// Returns the [`Labelled::intervals`] of a motion that lasts from `first_s` to `last_s`. `labels` has the label index
/// of each step.
pub(crate) fn intervals(
    found: &Probabilities,
    labels: &[usize],
    first_s: f64,
    last_s: f64,
) -> Vec<(Label, f64, f64, f64)> {
    let named: Vec<Label> = labels.iter().map(|label| Label::ALL[*label]).collect();
    let times: Vec<f64> = found.steps.iter().map(|step| *step as f64 * STEP_S).collect();
    // A label changes midway between two steps.
    let at = |i: usize| (found.steps[i] as f64 - 0.5) * STEP_S;
    let interval = |(label, span): (Label, Range<usize>)| {
        let begin = if span.start == 0 { first_s } else { at(span.start) };
        let end = if span.end == labels.len() { last_s } else { at(span.end) };
        let p = |i: usize| {
            let beside = if labels[i] == label.index() { 0.0 } else { found.p[i][labels[i]] };
            found.p[i][label.index()] + beside
        };
        let mean = span.clone().map(p).sum::<f64>() / span.len() as f64;
        (mean >= LEAST_CONFIDENCE).then_some((label, begin, end, mean))
    };
    event_spans(&named, &times, &found.speed_mps).into_iter().filter_map(interval).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_from_rest_is_a_start_too() {
        let mut labels = vec![Label::NotMoving; 40];
        labels[10..30].fill(Label::TurningLeft);
        labels[30..].fill(Label::Moving);
        let labels: Vec<usize> = labels.into_iter().map(Label::index).collect();
        let sure = |label: &usize| std::array::from_fn(|i| if i == *label { 0.86 } else { 0.02 });
        let found = Probabilities {
            steps: (0..40).collect(),
            p: labels.iter().map(sure).collect(),
            gap_s: vec![0.0; 40],
            // The speed rises to 5 m/s in the first half of the turn.
            speed_mps: (0..40_u32).map(|i| (f64::from(i) - 9.0).clamp(0.0, 10.0) * 0.5).collect(),
        };
        let events = intervals(&found, &labels, 0.0, 7.8);
        let names: Vec<Label> = events.iter().map(|interval| interval.0).collect();
        assert_eq!(names, [Label::Starting, Label::TurningLeft, Label::Moving], "{events:?}");
        let (start, turn) = (events[0], events[1]);
        assert!((start.1 - 1.9).abs() < 1e-9 && (start.2 - 3.7).abs() < 0.3, "{start:?}");
        assert!((turn.1 - 1.9).abs() < 1e-9 && (turn.2 - 5.9).abs() < 1e-9, "{turn:?}");
        assert!((start.3 - 0.88).abs() < 1e-9, "the sum of the probabilities of turn and start");
    }
}
