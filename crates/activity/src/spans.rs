//! Finds the samples of each event.
//!
//! Each sample has one label: a vehicle that turns while it starts is labelled as turning. People who label video mark
//! both activities. In the data set MEVA, every fifth start overlaps a turn. So the events here include both the start
//! and the turn.

use std::ops::Range;

use crate::label::Label;

/// Least acceleration of a vehicle that is still starting, m/s².
const GAIN_MPS2: f64 = 0.3;
/// Time over which the acceleration is measured, s.
const AHEAD_S: f64 = 0.6;

/// Returns the spans of consecutive samples with the same label. Spans with the label not moving are left out.
#[must_use]
pub fn label_spans(labels: &[Label]) -> Vec<(Label, Range<usize>)> {
    let mut to = 0;
    let spans = labels.chunk_by(|a, b| a == b).map(|run| {
        to += run.len();
        (run[0], to - run.len()..to)
    });
    spans.filter(|(label, _)| *label != Label::NotMoving).collect()
}

/// Returns the spans of all events, sorted by their beginning. They are the spans of [`label_spans`], and the starts
/// and stops that include a turn or U-turn.
///
/// A start that includes a turn begins after a rest, and lasts while the speed rises. A stop that includes a turn lasts
/// while the speed falls, until a rest. If a start begins before its turn, both parts are one span.
///
/// `labels`, `time_s` (s, rising) and `speed_mps` (of either sign) have one value per sample.
#[must_use]
pub fn event_spans(labels: &[Label], time_s: &[f64], speed_mps: &[f64]) -> Vec<(Label, Range<usize>)> {
    let speed: Vec<f64> = speed_mps.iter().map(|speed| speed.abs()).collect();
    let starts = starts_in_turns(labels, time_s, &speed, Label::Starting).into_iter();
    let mut shared: Vec<_> = starts.map(|span| (Label::Starting, span)).collect();
    // A stop is a start in reversed time.
    let backwards =
        |values: &[f64], sign: f64| values.iter().rev().map(|value| sign * value).collect::<Vec<_>>();
    let (time_s, speed) = (backwards(time_s, -1.0), backwards(&speed, 1.0));
    let reversed: Vec<Label> = labels.iter().rev().copied().collect();
    let n = labels.len();
    let stops = starts_in_turns(&reversed, &time_s, &speed, Label::Stopping).into_iter();
    shared.extend(stops.map(|span| (Label::Stopping, n - span.end..n - span.start)));

    let mut spans = label_spans(labels);
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

/// Returns the spans of starts that include a turn. `plain` is the label of their samples outside the turn. For stops,
/// all arguments are in reversed time.
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

    /// Returns the times (s) and speeds (m/s) of a car, with 10 samples per second. The car rests for 2 s, speeds up by
    /// 1.5 m/s² to 4.5 m/s, and drives on. It slows down by 1.5 m/s², and is at rest from 14 s.
    fn drive() -> (Vec<f64>, Vec<f64>) {
        let time_s: Vec<f64> = (0..160).map(|i| f64::from(i) * 0.1).collect();
        let speed = |t: &f64| (1.5 * (t - 2.0)).min(1.5 * (14.0 - t)).clamp(0.0, 4.5);
        let speed = time_s.iter().map(speed).collect();
        (time_s, speed)
    }

    /// Returns the events of the drive. The label from 2 to 14 s is `driving`, except in the intervals of `but` (s),
    /// which have their own labels.
    fn events(driving: Label, but: &[(f64, f64, Label)]) -> Vec<(Label, f64, f64)> {
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
        let found = events(Label::TurningLeft, &[]);
        let names: Vec<Label> = found.iter().map(|found| found.0).collect();
        assert_eq!(names, [Label::Starting, Label::TurningLeft, Label::Stopping]);
        // The speed rises from 2 to 5 s and falls from 11 to 14 s.
        let expected = [(2.0, 5.0), (2.0, 14.0), (11.0, 14.0)];
        for ((_, from, to), (begin, end)) in found.iter().zip(expected) {
            assert!((from - begin).abs() < 0.6 && (to - end).abs() < 0.6, "{found:?}");
        }
    }

    #[test]
    fn a_start_before_its_turn_includes_its_part_in_the_turn() {
        let found = events(Label::TurningRight, &[(2.0, 3.0, Label::Starting), (9.0, 14.0, Label::Moving)]);
        let names: Vec<Label> = found.iter().map(|found| found.0).collect();
        assert_eq!(names, [Label::Starting, Label::TurningRight, Label::Moving]);
        assert!(found[0].1 < 2.15 && found[0].2 > 4.0, "{found:?}");
    }

    #[test]
    fn without_a_turn_or_a_rest_there_is_nothing_to_add() {
        let count = |driving, but: &[_]| events(driving, but).len();
        assert_eq!(count(Label::Moving, &[(2.0, 5.0, Label::Starting), (11.0, 14.0, Label::Stopping)]), 3);
        assert_eq!(count(Label::Reversing, &[]), 1);
        let at_speed = [(2.0, 6.0, Label::Moving), (10.0, 14.0, Label::Moving)];
        assert_eq!(count(Label::UTurn, &at_speed), 3);
        assert!(event_spans(&[], &[], &[]).is_empty());
    }
}
