//! Probabilities at steps → one label a sample: the steadiest labels, then the rules.

use crate::events::{Labelled, stretches};
use crate::label::{LABELS, Label};
use crate::motion::{Motion, STEP_S};
use crate::rules::{bend, drive_on, settle};

/// What a change of label costs, as a logarithm of probability: labels that hold for a step or two are flicker.
const CHANGE_COST: f64 = 3.0;
/// Probabilities are not taken for less: the net is not that sure.
const LEAST_P: f64 = 1e-4;
/// Farther than this from a sighting (s) a vehicle's motion is guesswork: it stands or drives on, as far as anyone can tell,
/// and other labels cost so much a step, as a logarithm of probability.
const UNSEEN_S: f64 = 0.4;
/// See [`UNSEEN_S`].
const UNSEEN_COST: f64 = 2.0;

/// Probabilities of the labels at steps of the grid, which may skip where the vehicle stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Probabilities {
    /// Steps, rising, as multiples of [`crate::STEP_S`].
    pub steps: Vec<i64>,
    /// By [`Label::index`].
    pub p: Vec<[f64; LABELS]>,
    /// Time from each step to the nearest sighting, s, up to 2.
    pub gap_s: Vec<f64>,
    /// Speed at each step, m/s.
    pub speed_mps: Vec<f64>,
}

/// The labels that are most probable together, where each change costs (Viterbi 1967).
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
    /// The steadiest labels at samples' times (s, rising), without the rules, which look at motion: for nets that see
    /// something else.
    #[must_use]
    pub fn steady(&self, time_s: &[f64]) -> Labelled {
        at_samples(self, &steady(self), time_s)
    }
}

/// Labels of a motion's samples.
pub(crate) fn labelled(found: &Probabilities, motion: &Motion) -> Labelled {
    let mut labels = steady(found);
    settle(&mut labels, &found.steps, motion);
    bend(&mut labels, &found.steps, motion);
    drive_on(&mut labels, found);
    at_samples(found, &labels, &motion.time_s)
}

/// Each sample has the label of the nearest step; where steps were skipped the last before holds.
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
    Labelled { samples, stretches: stretches(found, labels, *first_s, *last_s) }
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

    /// At 2 m/s.
    fn driving(times: &[f64]) -> Motion {
        Motion {
            time_s: times.to_vec(),
            xy_m: times.iter().map(|t| [2.0 * t, 0.0]).collect(),
            ..Motion::default()
        }
    }

    #[test]
    fn what_is_not_seen_or_stays_is_no_event() {
        let mut told = vec![Label::NotMoving; 30];
        told[10..20].fill(Label::Reversing);
        let times: Vec<f64> = (0..59).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let mut found = sure(&told);
        assert_eq!(labelled(&found, &driving(&times)).stretches.len(), 1);
        let mut wavering = driving(&times);
        wavering.xy_m.iter_mut().for_each(|xy| xy[0] *= 0.25);
        assert!(labelled(&found, &wavering).stretches.is_empty());
        found.gap_s[10..20].fill(1.0);
        assert!(labelled(&found, &driving(&times)).stretches.is_empty());
    }

    #[test]
    fn who_leaves_as_the_track_ends_has_left_its_place() {
        let mut told = vec![Label::NotMoving; 30];
        told[22..].fill(Label::Starting);
        let times: Vec<f64> = (0..59).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let label_at_the_end = |speed: f64| {
            let mut motion = driving(&times);
            motion.xy_m.iter_mut().for_each(|xy| xy[0] *= speed / 2.0);
            labelled(&sure(&told), &motion).samples[58].0
        };
        // Within 1.4 s.
        assert_eq!(label_at_the_end(1.2), Label::Starting);
        assert_eq!(label_at_the_end(0.3), Label::NotMoving);
    }

    #[test]
    fn flicker_goes_and_changes_stay() {
        let (stand, start, go) = (Label::NotMoving, Label::Starting, Label::Moving);
        let mut told = vec![stand; 10];
        told.extend([start; 12]);
        told.extend([go; 8]);
        told[4] = Label::Reversing;
        let times: Vec<f64> = (0..59).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let labelled = labelled(&sure(&told), &driving(&times));
        assert_eq!(labelled.samples[8].0, stand);
        assert!((labelled.samples[8].1 - 0.02).abs() < 1e-12, "the net's own probability");
        let events: Vec<crate::Event> = labelled.events(7).collect();
        assert_eq!(events.iter().map(|e| e.activity).collect::<Vec<_>>(), [start, go]);
        assert!((events[0].from_s - 2.9).abs() < 1e-9 && (events[0].to_s - 5.3).abs() < 1e-9, "{events:?}");
        assert!((events[1].to_s - times[58]).abs() < 1e-9 && events[0].track == 7);
        assert!((events[0].confidence - 0.86).abs() < 1e-9);
    }

    #[test]
    fn who_was_not_seen_to_stand_drives_on() {
        let mut told = vec![Label::Moving; 10];
        told.extend([Label::Stopping; 10]);
        told.extend([Label::NotMoving; 20]);
        let times: Vec<f64> = (0..79).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let mut motion = driving(&times);
        motion.xy_m.iter_mut().for_each(|xy| xy[0] = xy[0].min(10.0));
        let mut found = sure(&told);
        let label_at_3_s = |found: &Probabilities| labelled(found, &motion).samples[20].0;
        assert_eq!(label_at_3_s(&found), Label::Stopping);
        found.gap_s[20..].iter_mut().enumerate().for_each(|(i, gap)| *gap = 0.2 * (i + 1) as f64);
        assert_eq!(label_at_3_s(&found), Label::Moving);
        // Seen at its end alone, long after.
        found.gap_s[39] = 0.0;
        assert_eq!(label_at_3_s(&found), Label::Moving);
    }

    #[test]
    fn a_turn_bends_the_way_and_a_u_turn_bends_it_far() {
        let times: Vec<f64> = (0..79).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        let label_of = |told: Label, turned_deg: f64| {
            let mut labels = vec![Label::Moving; 40];
            labels[10..30].fill(told);
            let mut motion = driving(&times);
            // An arc over the middle four seconds.
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
        // Three samples beside each other bend by chance.
        assert!(turned(&[[0.0, 0.0], [0.2, 0.0], [0.1, 0.15]]).unwrap().abs() < 0.2);
    }

    #[test]
    fn without_motion_the_steadiest_labels_are_told() {
        let mut told = vec![Label::Moving; 30];
        told[10..20].fill(Label::UTurn);
        told[25] = Label::Stopping;
        let times: Vec<f64> = (0..59).map(|i| 1.0 + f64::from(i) * 0.1).collect();
        // The rules take a U-turn on a straight way back; here nothing is known of the way.
        assert_eq!(labelled(&sure(&told), &driving(&times)).samples[25].0, Label::Moving);
        let labelled = sure(&told).steady(&times);
        assert_eq!(labelled.samples[25].0, Label::UTurn);
        assert_eq!(labelled.samples[40].0, Label::Moving);
        assert!(sure(&told).steady(&[]).samples.is_empty() && sure(&[]).steady(&times).samples.is_empty());
    }

    #[test]
    fn what_was_skipped_is_as_before() {
        let mut found = sure(&[Label::NotMoving, Label::NotMoving, Label::Moving, Label::Moving]);
        found.steps = vec![0, 1, 500, 510];
        let labelled = labelled(&found, &driving(&[0.0, 50.0, 100.0, 102.0]));
        let labels: Vec<Label> = labelled.samples.iter().map(|(label, _)| *label).collect();
        assert_eq!(labels, [Label::NotMoving, Label::NotMoving, Label::Moving, Label::Moving]);
    }
}
