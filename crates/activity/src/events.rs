//! Labels of steps → events: stretches of one label, and starts and stops within turns.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::decode::Probabilities;
use crate::label::Label;
use crate::motion::STEP_S;
use crate::spans::event_spans;

/// Events that are less probable than their opposite are not told.
const LEAST_CONFIDENCE: f64 = 0.5;

/// A stretch in which a vehicle does one thing; a start or stop within a turn shares its time with the turn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Of which track.
    pub track: u64,
    /// What it does.
    pub activity: Label,
    /// Beginning, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Mean probability over its steps; of a start or stop within a turn, that it is the one or the other.
    pub confidence: f64,
}

/// What a vehicle does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Labelled {
    /// Per sample its label and the net's probability of it.
    pub samples: Vec<(Label, f64)>,
    /// Stretches of one label, by their beginning, of all but standing and what is told with less than even odds: label,
    /// beginning and end (s), mean probability. Starts and stops may share their time with turns.
    pub stretches: Vec<(Label, f64, f64, f64)>,
}

impl Labelled {
    /// The stretches as events of a track.
    pub fn events(&self, track: u64) -> impl Iterator<Item = Event> {
        self.stretches.iter().map(move |&(activity, from_s, to_s, confidence)| Event {
            track,
            activity,
            from_s,
            to_s,
            confidence,
        })
    }
}

/// See [`Labelled::stretches`]; of a motion from `first_s` to `last_s`.
pub(crate) fn stretches(
    found: &Probabilities,
    labels: &[usize],
    first_s: f64,
    last_s: f64,
) -> Vec<(Label, f64, f64, f64)> {
    let named: Vec<Label> = labels.iter().map(|label| Label::ALL[*label]).collect();
    let times: Vec<f64> = found.steps.iter().map(|step| *step as f64 * STEP_S).collect();
    // A change lies between two steps.
    let at = |i: usize| (found.steps[i] as f64 - 0.5) * STEP_S;
    let stretch = |(label, span): (Label, Range<usize>)| {
        let begin = if span.start == 0 { first_s } else { at(span.start) };
        let end = if span.end == labels.len() { last_s } else { at(span.end) };
        let p = |i: usize| {
            let beside = if labels[i] == label.index() { 0.0 } else { found.p[i][labels[i]] };
            found.p[i][label.index()] + beside
        };
        let mean = span.clone().map(p).sum::<f64>() / span.len() as f64;
        (mean >= LEAST_CONFIDENCE).then_some((label, begin, end, mean))
    };
    event_spans(&named, &times, &found.speed_mps).into_iter().filter_map(stretch).collect()
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
            // Up to 5 m/s within the turn's first half.
            speed_mps: (0..40_u32).map(|i| (f64::from(i) - 9.0).clamp(0.0, 10.0) * 0.5).collect(),
        };
        let told = stretches(&found, &labels, 0.0, 7.8);
        let names: Vec<Label> = told.iter().map(|stretch| stretch.0).collect();
        assert_eq!(names, [Label::Starting, Label::TurningLeft, Label::Moving], "{told:?}");
        let (start, turn) = (told[0], told[1]);
        assert!((start.1 - 1.9).abs() < 1e-9 && (start.2 - 3.7).abs() < 0.3, "{start:?}");
        assert!((turn.1 - 1.9).abs() < 1e-9 && (turn.2 - 5.9).abs() < 1e-9, "{turn:?}");
        assert!((start.3 - 0.88).abs() < 1e-9, "the turn's probability and the start's");
    }
}
