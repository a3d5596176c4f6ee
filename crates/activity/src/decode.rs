//! Probabilities at steps → one label a sample, and events.

use serde::{Deserialize, Serialize};

use crate::label::{LABELS, Label};
use crate::motion::STEP_S;
use crate::net::Probabilities;

/// What a change of label costs, as a logarithm of probability: labels that hold for a step or two are flicker.
const CHANGE_COST: f64 = 3.0;
/// Probabilities are not taken for less: the net is not that sure.
const LEAST_P: f64 = 1e-4;

/// A stretch in which a vehicle does one thing.
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
    /// Mean probability over its steps.
    pub confidence: f64,
}

/// What a vehicle does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Labelled {
    /// Per sample its label and the net's probability of it.
    pub samples: Vec<(Label, f64)>,
    /// Stretches of one label, by time, of all but standing: label, beginning and end (s), mean probability.
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

/// The labels that are most probable together, where each change costs (Viterbi 1967).
fn steady(p: &[[f64; LABELS]]) -> Vec<usize> {
    let gain = |p: &[f64; LABELS], label: usize| p[label].max(LEAST_P).ln();
    let best_of =
        |score: &[f64; LABELS]| (0..LABELS).fold(0, |best, i| if score[i] > score[best] { i } else { best });
    let Some(first) = p.first() else { return Vec::new() };
    let mut score: [f64; LABELS] = std::array::from_fn(|label| gain(first, label));
    let mut came_from: Vec<[usize; LABELS]> = Vec::with_capacity(p.len());
    for step in &p[1..] {
        let best = best_of(&score);
        let from: [usize; LABELS] =
            std::array::from_fn(|label| if score[best] - CHANGE_COST > score[label] { best } else { label });
        let stay_or_change =
            |label: usize| if from[label] == label { score[label] } else { score[best] - CHANGE_COST };
        score = std::array::from_fn(|label| stay_or_change(label) + gain(step, label));
        came_from.push(from);
    }
    let mut labels = vec![best_of(&score)];
    for from in came_from.iter().rev() {
        labels.push(from[labels[labels.len() - 1]]);
    }
    labels.reverse();
    labels
}

/// Labels of samples at these times (s, rising), each that of the nearest step; where steps were skipped the last before
/// holds.
pub(crate) fn labelled(found: &Probabilities, time_s: &[f64]) -> Labelled {
    let (Some(first_s), Some(last_s)) = (time_s.first(), time_s.last()) else { return Labelled::default() };
    let labels = steady(&found.p);
    let of_time = |t: f64| {
        let step = (t / STEP_S).round() as i64;
        found.steps.partition_point(|s| *s <= step).saturating_sub(1)
    };
    let samples = time_s
        .iter()
        .map(|t| {
            let i = of_time(*t);
            (Label::ALL[labels[i]], found.p[i][labels[i]])
        })
        .collect();
    let mut stretches = Vec::new();
    let mut from = 0;
    for stretch in labels.chunk_by(|a, b| a == b) {
        let to = from + stretch.len();
        let label = stretch[0];
        // A change lies between two steps.
        let at = |i: usize| (found.steps[i] as f64 - 0.5) * STEP_S;
        let begin = if from == 0 { *first_s } else { at(from) };
        let end = if to == labels.len() { *last_s } else { at(to) };
        let mean = found.p[from..to].iter().map(|p| p[label]).sum::<f64>() / stretch.len() as f64;
        if Label::ALL[label] != Label::NotMoving {
            stretches.push((Label::ALL[label], begin, end, mean));
        }
        from = to;
    }
    Labelled { samples, stretches }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sure(labels: &[Label]) -> Probabilities {
        let p = labels.iter().map(|label| {
            let mut p = [0.02; LABELS];
            p[label.index()] = 0.86;
            p
        });
        Probabilities { steps: (5..).take(labels.len()).collect(), p: p.collect() }
    }

    #[test]
    fn flicker_goes_and_changes_stay() {
        let (stand, start, go) = (Label::NotMoving, Label::Starting, Label::Moving);
        let mut told = vec![stand; 10];
        told.extend([start; 12]);
        told.extend([go; 8]);
        told[4] = Label::Reversing;
        let times: Vec<f64> = (0..59).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let labelled = labelled(&sure(&told), &times);
        assert_eq!(labelled.samples[8].0, stand);
        assert!((labelled.samples[8].1 - 0.02).abs() < 1e-12, "the net's own probability");
        let events: Vec<Event> = labelled.events(7).collect();
        assert_eq!(events.iter().map(|e| e.activity).collect::<Vec<_>>(), [start, go]);
        assert!((events[0].from_s - 2.9).abs() < 1e-9 && (events[0].to_s - 5.3).abs() < 1e-9, "{events:?}");
        assert!((events[1].to_s - times[58]).abs() < 1e-9 && events[0].track == 7);
        assert!((events[0].confidence - 0.86).abs() < 1e-9);
    }

    #[test]
    fn what_was_skipped_is_as_before() {
        let mut found = sure(&[Label::NotMoving, Label::NotMoving, Label::Moving]);
        found.steps = vec![0, 1, 500];
        let labelled = labelled(&found, &[0.0, 50.0, 100.0]);
        assert_eq!(labelled.samples.map_labels(), [Label::NotMoving, Label::NotMoving, Label::Moving]);
    }

    trait MapLabels {
        fn map_labels(&self) -> Vec<Label>;
    }
    impl MapLabels for Vec<(Label, f64)> {
        fn map_labels(&self) -> Vec<Label> {
            self.iter().map(|(label, _)| *label).collect()
        }
    }
}
