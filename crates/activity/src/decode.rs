//! Converts the probabilities of labels at time steps to one label per sample. It computes the most probable sequence
//! of labels, and corrects the sequence by rules.

use crate::events::{Labelled, intervals};
use crate::label::{LABELS, Label};
use crate::motion::{Motion, STEP_S};
use crate::probabilities::Probabilities;
use crate::rules::{check_turns, drive_on, settle};

/// Cost of a change of label between two steps, as a log probability. The cost removes flicker: labels that last only a
/// step or two.
const CHANGE_COST: f64 = 3.0;
/// Lowest probability of a label. Smaller outputs of the net are raised to this value.
const LEAST_P: f64 = 1e-4;
/// Longest time between a step and the nearest observed sample at which the net's probabilities are used, s. At other
/// steps, all labels except `NotMoving` and `Moving` have a cost.
const UNSEEN_S: f64 = 0.4;
/// Cost of a step with a label other than `NotMoving` and `Moving`, as a log probability. The cost applies to steps
/// farther than [`UNSEEN_S`] from observed samples.
const UNSEEN_COST: f64 = 2.0;

/// Returns the most probable sequence of labels (Viterbi 1967), one label index per step. Each change of label has a
/// cost.
fn steady(found: &Probabilities) -> Vec<usize> {
    let plain = [Label::NotMoving.index(), Label::Moving.index()];
    let gain = |step: usize, label: usize| match found.gap_s[step] > UNSEEN_S {
        true if plain.contains(&label) => 0.0,
        true => -UNSEEN_COST,
        false => found.p[step][label].max(LEAST_P).ln(),
    };
    let best_of =
        |score: &[f64; LABELS]| (0..LABELS).fold(0, |best, i| if score[i] > score[best] { i } else { best });
    if found.p.is_empty() {
        return Vec::new();
    }
    let mut score: [f64; LABELS] = std::array::from_fn(|label| gain(0, label));
    let mut came_from: Vec<[usize; LABELS]> = Vec::with_capacity(found.p.len());
    for step in 1..found.p.len() {
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

impl Probabilities {
    /// Returns the most probable labels at the times of samples, without corrections by rules. `time_s` are the times
    /// in rising order, s.
    ///
    /// The rules need the motion of a vehicle. This function is for nets with another input, such as video.
    #[must_use]
    pub fn steady(&self, time_s: &[f64]) -> Labelled {
        at_samples(self, &steady(self), time_s)
    }
}

/// Returns the labels of a motion's samples and its intervals, corrected by rules.
pub(crate) fn labelled(found: &Probabilities, motion: &Motion) -> Labelled {
    let mut labels = steady(found);
    settle(&mut labels, &found.steps, motion);
    check_turns(&mut labels, &found.steps, motion);
    drive_on(&mut labels, found);
    at_samples(found, &labels, &motion.time_s)
}

/// Returns the label of each sample: the label of the nearest step. Where steps were skipped, a sample has the label of
/// the last step before the sample.
fn at_samples(found: &Probabilities, labels: &[usize], time_s: &[f64]) -> Labelled {
    let (Some(first_s), Some(last_s)) = (time_s.first(), time_s.last()) else { return Labelled::default() };
    if labels.is_empty() {
        return Labelled::default();
    }
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
    Labelled { samples, intervals: intervals(found, labels, *first_s, *last_s) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::turned;

    fn sure(labels: &[Label]) -> Probabilities {
        let p = labels.iter().map(|label| {
            let mut p = [0.02; LABELS];
            p[label.index()] = 0.86;
            p
        });
        Probabilities {
            steps: (5..).take(labels.len()).collect(),
            p: p.collect(),
            gap_s: vec![0.0; labels.len()],
            speed_mps: vec![2.0; labels.len()],
        }
    }

    /// Returns the motion of a vehicle that drives straight on at 2 m/s.
    fn driving(times: &[f64]) -> Motion {
        Motion {
            time_s: times.to_vec(),
            xy_m: times.iter().map(|t| [2.0 * t, 0.0]).collect(),
            ..Motion::default()
        }
    }

    #[test]
    fn an_event_needs_observed_motion() {
        let mut labels = vec![Label::NotMoving; 30];
        labels[10..20].fill(Label::Reversing);
        let times: Vec<f64> = (0..59).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let mut found = sure(&labels);
        assert_eq!(labelled(&found, &driving(&times)).intervals.len(), 1);
        let mut wavering = driving(&times);
        wavering.xy_m.iter_mut().for_each(|xy| xy[0] *= 0.25);
        assert!(labelled(&found, &wavering).intervals.is_empty());
        found.gap_s[10..20].fill(1.0);
        assert!(labelled(&found, &driving(&times)).intervals.is_empty());
    }

    #[test]
    fn a_car_that_leaves_as_its_track_ends_is_starting() {
        let mut labels = vec![Label::NotMoving; 30];
        labels[22..].fill(Label::Starting);
        let times: Vec<f64> = (0..59).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let label_at_the_end = |speed: f64| {
            let mut motion = driving(&times);
            motion.xy_m.iter_mut().for_each(|xy| xy[0] *= speed / 2.0);
            labelled(&sure(&labels), &motion).samples[58].0
        };
        // The vehicle moves during the last 1.4 s.
        assert_eq!(label_at_the_end(1.2), Label::Starting);
        assert_eq!(label_at_the_end(0.3), Label::NotMoving);
    }

    #[test]
    fn flicker_is_removed_and_changes_stay() {
        let (rest, start, go) = (Label::NotMoving, Label::Starting, Label::Moving);
        let mut labels = vec![rest; 10];
        labels.extend([start; 12]);
        labels.extend([go; 8]);
        labels[4] = Label::Reversing;
        let times: Vec<f64> = (0..59).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let labelled = labelled(&sure(&labels), &driving(&times));
        assert_eq!(labelled.samples[8].0, rest);
        assert!((labelled.samples[8].1 - 0.02).abs() < 1e-12, "the net's own probability");
        let events: Vec<crate::Event> = labelled.events(7).collect();
        assert_eq!(events.iter().map(|e| e.activity).collect::<Vec<_>>(), [start, go]);
        assert!((events[0].from_s - 2.9).abs() < 1e-9 && (events[0].to_s - 5.3).abs() < 1e-9, "{events:?}");
        assert!((events[1].to_s - times[58]).abs() < 1e-9 && events[0].track == 7);
        assert!((events[0].confidence - 0.86).abs() < 1e-9);
    }

    #[test]
    fn a_car_that_is_not_observed_at_rest_drives_on() {
        let mut labels = vec![Label::Moving; 10];
        labels.extend([Label::Stopping; 10]);
        labels.extend([Label::NotMoving; 20]);
        let times: Vec<f64> = (0..79).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let mut motion = driving(&times);
        motion.xy_m.iter_mut().for_each(|xy| xy[0] = xy[0].min(10.0));
        let mut found = sure(&labels);
        let label_at_3_s = |found: &Probabilities| labelled(found, &motion).samples[20].0;
        assert_eq!(label_at_3_s(&found), Label::Stopping);
        found.gap_s[20..].iter_mut().enumerate().for_each(|(i, gap)| *gap = 0.2 * (i + 1) as f64);
        assert_eq!(label_at_3_s(&found), Label::Moving);
        // The rest is observed only at its end, much later.
        found.gap_s[39] = 0.0;
        assert_eq!(label_at_3_s(&found), Label::Moving);
    }

    #[test]
    fn a_turn_needs_a_curve_and_a_u_turn_a_tight_one() {
        let times: Vec<f64> = (0..79).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let label_of = |label: Label, turned_deg: f64| {
            let mut labels = vec![Label::Moving; 40];
            labels[10..30].fill(label);
            let mut motion = driving(&times);
            // The path is an arc during the middle four seconds.
            let (mut at, mut heading) = ([0.0_f64; 2], 0.0_f64);
            for (time_s, xy) in times.iter().zip(&mut motion.xy_m) {
                heading += if (3.0..7.0).contains(time_s) { turned_deg.to_radians() / 40.0 } else { 0.0 };
                at = [at[0] + 0.4 * heading.cos(), at[1] + 0.4 * heading.sin()];
                *xy = at;
            }
            labelled(&sure(&labels), &motion).samples[40].0
        };
        assert_eq!(label_of(Label::UTurn, 170.0), Label::UTurn);
        assert_eq!(label_of(Label::UTurn, 90.0), Label::TurningLeft);
        assert_eq!(label_of(Label::UTurn, -90.0), Label::TurningRight);
        assert_eq!(label_of(Label::TurningLeft, 40.0), Label::TurningLeft);
        assert_eq!(label_of(Label::TurningLeft, 5.0), Label::Moving);
        assert_eq!(label_of(Label::UTurn, -5.0), Label::Moving);
        // A path through three samples that lie close together turns by chance.
        assert!(turned(&[[0.0, 0.0], [0.2, 0.0], [0.1, 0.15]]).unwrap().abs() < 0.2);
    }

    #[test]
    fn without_motion_no_rule_changes_the_labels() {
        let mut labels = vec![Label::Moving; 30];
        labels[10..20].fill(Label::UTurn);
        labels[25] = Label::Stopping;
        let times: Vec<f64> = (0..59).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        // The rules remove a U-turn on a straight path. Without a motion there is no path to check.
        assert_eq!(labelled(&sure(&labels), &driving(&times)).samples[25].0, Label::Moving);
        let labelled = sure(&labels).steady(&times);
        assert_eq!(labelled.samples[25].0, Label::UTurn);
        assert_eq!(labelled.samples[40].0, Label::Moving);
        assert!(sure(&labels).steady(&[]).samples.is_empty() && sure(&[]).steady(&times).samples.is_empty());
    }

    #[test]
    fn skipped_steps_keep_the_label_before_them() {
        let mut found = sure(&[Label::NotMoving, Label::NotMoving, Label::Moving, Label::Moving]);
        found.steps = vec![0, 1, 500, 510];
        let labelled = labelled(&found, &driving(&[0.0, 50.0, 100.0, 102.0]));
        let labels: Vec<Label> = labelled.samples.iter().map(|(label, _)| *label).collect();
        assert_eq!(labels, [Label::NotMoving, Label::NotMoving, Label::Moving, Label::Moving]);
    }
}
