//! Which samples an event is made of.
//!
//! One label holds at a time, and who turns while starting is turning. People who label video call it both (in MEVA every fifth
//! start shares its time with a turn), so events tell the start and the turn.

use std::ops::Range;

use crate::label::Label;

/// A vehicle still starts while it gains so much speed …
const GAIN_MPS2: f64 = 0.3;
/// … over the next so many seconds.
const AHEAD_S: f64 = 0.6;

/// Stretches of one label, but for standing, with their samples.
#[must_use]
pub fn stretch_spans(labels: &[Label]) -> Vec<(Label, Range<usize>)> {
    let mut to = 0;
    let spans = labels.chunk_by(|a, b| a == b).map(|stretch| {
        to += stretch.len();
        (stretch[0], to - stretch.len()..to)
    });
    spans.filter(|(label, _)| *label != Label::NotMoving).collect()
}

/// [`stretch_spans`], and starts and stops of which a turn or U-turn is a part: from the stand for as long as the speed rises, or
/// from where it begins to fall to the stand. A start that begins before its turn is told with all of it. By their beginning.
///
/// As many labels, times (s, rising) and speeds (m/s, of either sign) as there are samples.
#[must_use]
pub fn event_spans(labels: &[Label], time_s: &[f64], speed_mps: &[f64]) -> Vec<(Label, Range<usize>)> {
    let speed: Vec<f64> = speed_mps.iter().map(|speed| speed.abs()).collect();
    let starts = starts_in_turns(labels, time_s, &speed, Label::Starting).into_iter();
    let mut shared: Vec<_> = starts.map(|span| (Label::Starting, span)).collect();
    // A stop is a start, seen backwards.
    let backwards =
        |values: &[f64], sign: f64| values.iter().rev().map(|value| sign * value).collect::<Vec<_>>();
    let (time_s, speed) = (backwards(time_s, -1.0), backwards(&speed, 1.0));
    let reversed: Vec<Label> = labels.iter().rev().copied().collect();
    let n = labels.len();
    let stops = starts_in_turns(&reversed, &time_s, &speed, Label::Stopping).into_iter();
    shared.extend(stops.map(|span| (Label::Stopping, n - span.end..n - span.start)));

    let mut spans = stretch_spans(labels);
    spans.retain(|(label, part)| {
        let whole = |(other, span): &(Label, Range<usize>)| {
            other == label && span.start <= part.start && part.end <= span.end
        };
        !shared.iter().any(whole)
    });
    spans.extend(shared);
    spans.sort_by_key(|(label, span)| (span.start, *label));
    spans
}

/// Samples of starts that are called `plain` where there is no turn.
fn starts_in_turns(labels: &[Label], time_s: &[f64], speed: &[f64], plain: Label) -> Vec<Range<usize>> {
    let turns = |label: &Label| matches!(label, Label::TurningLeft | Label::TurningRight | Label::UTurn);
    let speeds_up = |i: usize| {
        let ahead = time_s.partition_point(|t| *t < time_s[i] + AHEAD_S).min(time_s.len() - 1);
        speed[ahead] - speed[i] > GAIN_MPS2 * (time_s[ahead] - time_s[i])
    };
    let mut found = Vec::new();
    for (from, pair) in labels.windows(2).enumerate() {
        if pair[0] != Label::NotMoving || pair[1] == Label::NotMoving {
            continue;
        }
        let from = from + 1;
        let goes_on = |i: &usize| (labels[*i] == plain || turns(&labels[*i])) && speeds_up(*i);
        let to = (from..labels.len()).take_while(goes_on).last().map_or(from, |last| last + 1);
        if labels[from..to].iter().any(turns) {
            found.push(from..to);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stands for 2 s, speeds up by 1.5 m/s² to 4.5 m/s, drives on, and slows down alike to a stand at 14 s; 10 samples a second.
    fn drive() -> (Vec<f64>, Vec<f64>) {
        let time_s: Vec<f64> = (0..160).map(|i| f64::from(i) * 0.1).collect();
        let speed = |t: &f64| (1.5 * (t - 2.0)).min(1.5 * (14.0 - t)).clamp(0.0, 4.5);
        let speed = time_s.iter().map(speed).collect();
        (time_s, speed)
    }

    /// What is told of the drive with this label from 2 to 14 s but for these stretches (s).
    fn told(driving: Label, but: &[(f64, f64, Label)]) -> Vec<(Label, f64, f64)> {
        let (time_s, speed) = drive();
        let label = |t: &f64| {
            let other = but.iter().find(|(from, to, _)| (*from..*to).contains(t));
            other.map_or(if (2.0..14.0).contains(t) { driving } else { Label::NotMoving }, |other| other.2)
        };
        let labels: Vec<Label> = time_s.iter().map(label).collect();
        let found = event_spans(&labels, &time_s, &speed);
        assert!(found.iter().all(|(label, span)| *label != Label::NotMoving && !span.is_empty()));
        found.into_iter().map(|(label, span)| (label, time_s[span.start], time_s[span.end - 1])).collect()
    }

    #[test]
    fn a_turn_from_rest_to_rest_has_a_start_and_a_stop() {
        let found = told(Label::TurningLeft, &[]);
        let names: Vec<Label> = found.iter().map(|found| found.0).collect();
        assert_eq!(names, [Label::Starting, Label::TurningLeft, Label::Stopping]);
        // Speed rises from 2 to 5 s and falls from 11 to 14 s.
        let expected = [(2.0, 5.0), (2.0, 14.0), (11.0, 14.0)];
        for ((_, from, to), (begin, end)) in found.iter().zip(expected) {
            assert!((from - begin).abs() < 0.6 && (to - end).abs() < 0.6, "{found:?}");
        }
    }

    #[test]
    fn a_start_that_comes_before_its_turn_is_told_with_all_of_it() {
        let found = told(Label::TurningRight, &[(2.0, 3.0, Label::Starting), (9.0, 14.0, Label::Moving)]);
        let names: Vec<Label> = found.iter().map(|found| found.0).collect();
        assert_eq!(names, [Label::Starting, Label::TurningRight, Label::Moving]);
        assert!(found[0].1 < 2.15 && found[0].2 > 4.0, "{found:?}");
    }

    #[test]
    fn without_a_turn_or_a_stand_there_is_nothing_to_add() {
        let count = |driving, but: &[_]| told(driving, but).len();
        assert_eq!(count(Label::Moving, &[(2.0, 5.0, Label::Starting), (11.0, 14.0, Label::Stopping)]), 3);
        assert_eq!(count(Label::Reversing, &[]), 1);
        let at_speed = [(2.0, 6.0, Label::Moving), (10.0, 14.0, Label::Moving)];
        assert_eq!(count(Label::UTurn, &at_speed), 3);
        assert!(event_spans(&[], &[], &[]).is_empty());
    }
}
