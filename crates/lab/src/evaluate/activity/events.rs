//! Scores reported events against true events, in the manner of NIST's evaluation of activities in video (ActEV).
//!
//! The scores are the share of missed true events at given rates of false alarms, and the temporal overlap of the hits.
//! One rule is stricter than NIST's: an event must be reported for the right car. A reported event is a hit if it
//! overlaps a true event of the same car and label by one second. An overlap by half of the true event's length is also
//! enough. The reported event with the highest confidence is matched first.

use roadplane_activity::{LABELS, Label};
use roadplane_tables::bootstrap_scenes;
use roadplane_tables::{Column, Estimate, Table};

/// Rates of false alarms at which misses are counted: false alarms of one label per minute of video.
///
/// ActEV uses a rate of 0.15, which allows no false alarm in clips of a few seconds.
const ALARMS_PER_MIN: [f64; 3] = [0.15, 1.0, 4.0];
/// Length of an overlap in time that is always enough for a hit, s.
const ENOUGH_S: f64 = 1.0;

/// A true event: an interval in which a car has one activity.
#[derive(Clone, Debug)]
pub struct TrueEvent {
    /// Id of the true car.
    pub car: u64,
    /// The activity.
    pub label: Label,
    /// Start and end, s.
    pub span_s: [f64; 2],
    /// Whether the event must be found. With `false`, the event is never a miss, and a report of it is no false alarm.
    pub counts: bool,
}

/// An event that a system reports.
#[derive(Clone, Debug)]
pub struct ReportedEvent {
    /// Id of the true car that the reported track follows; `None` if the track follows no true car.
    pub car: Option<u64>,
    /// The activity.
    pub label: Label,
    /// Start and end, s.
    pub span_s: [f64; 2],
    /// Confidence, 0–1.
    pub confidence: f64,
}

/// Hits and false alarms of each system in one clip.
#[derive(Clone, Debug)]
pub struct ClipEvents {
    minutes: f64,
    truths: [usize; LABELS],
    /// For each system, the events that it reports, in order of falling confidence.
    reported: Vec<Vec<Judged>>,
}

/// A reported event after matching. `hit` is the temporal intersection over union with the true event; `None` marks a
/// false alarm.
#[derive(Clone, Copy, Debug)]
struct Judged {
    label: usize,
    confidence: f64,
    hit: Option<f64>,
}

impl ClipEvents {
    /// Matches the events that each system reports with the true events of a clip. `minutes` is the clip's length.
    pub fn new(minutes: f64, truths: &[TrueEvent], reported: Vec<Vec<ReportedEvent>>) -> Self {
        let mut counted = [0; LABELS];
        truths.iter().filter(|event| event.counts).for_each(|event| counted[event.label.index()] += 1);
        let reported = reported.into_iter().map(|events| judged(truths, events)).collect();
        Self { minutes, truths: counted, reported }
    }
}

/// Returns the length of the intersection of two spans, s.
fn shared(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[1].min(b[1]) - a[0].max(b[0])).max(0.0)
}

/// Matches reported events with true events, in order of falling confidence.
fn judged(truths: &[TrueEvent], mut reported: Vec<ReportedEvent>) -> Vec<Judged> {
    reported.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
    let mut free = vec![true; truths.len()];
    let mut judged = Vec::new();
    for event in reported {
        let overlap = |i: &usize| shared(truths[*i].span_s, event.span_s);
        let fits = |i: &usize| {
            let truth = &truths[*i];
            let length_s = truth.span_s[1] - truth.span_s[0];
            let same = event.car == Some(truth.car) && event.label == truth.label;
            // Several reported events may match a true event that need not be found.
            same && (free[*i] || !truth.counts) && overlap(i) >= ENOUGH_S.min(length_s / 2.0)
        };
        let best = (0..truths.len()).filter(fits).max_by(|a, b| overlap(a).total_cmp(&overlap(b)));
        if best.is_some_and(|i| !truths[i].counts) {
            continue;
        }
        let hit = best.map(|i| {
            free[i] = false;
            let [a, b] = [truths[i].span_s, event.span_s];
            overlap(&i) / (a[1].max(b[1]) - a[0].min(b[0])).max(1e-9)
        });
        judged.push(Judged { label: event.label.index(), confidence: event.confidence, hit });
    }
    judged
}

/// The scores of one system for one label.
#[derive(Clone, Copy, Debug, PartialEq)]
struct OfLabel {
    /// Shares of missed true events: one for each rate of [`ALARMS_PER_MIN`], and one with all reported events.
    missed: [f64; 4],
    /// False alarms per minute with all reported events.
    alarms_per_min: f64,
    /// Mean temporal intersection over union of the hits; NaN if there is no hit.
    overlap: f64,
}

fn of_label(clips: &[&ClipEvents], system: usize, label: usize) -> Option<OfLabel> {
    let truths: usize = clips.iter().map(|clip| clip.truths[label]).sum();
    if truths == 0 {
        return None;
    }
    let minutes: f64 = clips.iter().map(|clip| clip.minutes).sum();
    let mut reported: Vec<Judged> = clips
        .iter()
        .flat_map(|clip| &clip.reported[system])
        .filter(|event| event.label == label)
        .copied()
        .collect();
    reported.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
    let missed_at = |per_min: f64| {
        let (mut hits, mut alarms) = (0_usize, 0_usize);
        for event in &reported {
            if event.hit.is_some() {
                hits += 1;
            } else {
                alarms += 1;
                if alarms as f64 > per_min * minutes {
                    break;
                }
            }
        }
        1.0 - hits as f64 / truths as f64
    };
    let overlaps: Vec<f64> = reported.iter().filter_map(|event| event.hit).collect();
    let [few, some, many] = ALARMS_PER_MIN;
    Some(OfLabel {
        missed: [few, some, many, f64::INFINITY].map(missed_at),
        alarms_per_min: (reported.len() - overlaps.len()) as f64 / minutes,
        overlap: overlaps.iter().sum::<f64>() / overlaps.len() as f64,
    })
}

/// Returns the numbers of a table row, in the order of the columns. Each number is a mean over labels.
///
/// The mean overlap leaves out labels without hits.
fn numbers(each: &[OfLabel]) -> [f64; 6] {
    let mean = |of: &dyn Fn(&OfLabel) -> f64| {
        let values: Vec<f64> = each.iter().map(of).filter(|value| !value.is_nan()).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    let missed = |i: usize| mean(&move |label: &OfLabel| label.missed[i]);
    [
        missed(0),
        missed(1),
        missed(2),
        missed(3),
        mean(&|label| label.alarms_per_min),
        mean(&|label| label.overlap),
    ]
}

fn columns(first: &[&str]) -> Vec<Column> {
    let at = ALARMS_PER_MIN.map(|rate| format!("missed at {rate} alarms/min"));
    let rest = ["missed", "alarms/min", "temporal IoU of hits"];
    let names = at.iter().map(String::as_str).chain(rest).map(|name| Column::new(name, 2));
    first.iter().map(|name| Column::new(*name, 0)).chain(names).collect()
}

/// Returns the table of all systems. Each number is a mean over the given labels, with a confidence interval from
/// resampling clips.
pub fn table(clips: &[ClipEvents], systems: &[&str], labels: &[Label]) -> Table {
    let note = "Means over labels. A hit is an event of the right car and label that overlaps the true one by 1 s, \
        or by half of it; alarms are counted per label.";
    let mut table = Table::new("Events", note, columns(&[""]));
    for (system, name) in systems.iter().enumerate() {
        let row = |clips: &[&ClipEvents]| {
            let each: Vec<OfLabel> =
                labels.iter().filter_map(|label| of_label(clips, system, label.index())).collect();
            numbers(&each)
        };
        let estimates = estimates(clips, row);
        table.rows.push(std::iter::once((*name).into()).chain(estimates.map(Into::into)).collect());
    }
    table
}

/// Returns the table of one system, with one row per label.
pub fn each_label(title: &str, clips: &[ClipEvents], system: usize, labels: &[Label]) -> Table {
    let mut table = Table::new(title, "", columns(&["", "true events"]));
    let all: Vec<&ClipEvents> = clips.iter().collect();
    for label in labels {
        let Some(found) = of_label(&all, system, label.index()) else { continue };
        let truths: usize = clips.iter().map(|clip| clip.truths[label.index()]).sum();
        let head = [label.name().into(), (truths as f64).into()];
        table.rows.push(head.into_iter().chain(numbers(&[found]).map(Into::into)).collect());
    }
    table
}

fn estimates(clips: &[ClipEvents], row: impl Fn(&[&ClipEvents]) -> [f64; 6]) -> [Estimate; 6] {
    let n = clips.iter().flat_map(|clip| clip.truths).sum();
    std::array::from_fn(|i| bootstrap_scenes(clips, n, |chosen| row(chosen)[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth(car: u64, label: Label, span_s: [f64; 2]) -> TrueEvent {
        TrueEvent { car, label, span_s, counts: true }
    }

    fn reported(car: u64, label: Label, span_s: [f64; 2], confidence: f64) -> ReportedEvent {
        ReportedEvent { car: Some(car), label, span_s, confidence }
    }

    #[test]
    fn hits_alarms_and_overlap_by_hand() {
        let (start, left) = (Label::Starting, Label::TurningLeft);
        let truths = [truth(1, start, [0.0, 4.0]), truth(2, start, [10.0, 11.0]), truth(1, left, [4.0, 8.0])];
        let events = vec![
            reported(1, start, [2.0, 6.0], 0.9),   // a hit: overlap 2 s, union 6 s
            reported(1, start, [0.0, 4.0], 0.8),   // the true event is matched already
            reported(3, start, [0.0, 4.0], 0.7),   // another car
            reported(2, start, [10.4, 11.0], 0.6), // a hit: more than half of the true event
            reported(1, left, [7.5, 9.0], 0.9),    // too small an overlap
        ];
        let clip = ClipEvents::new(2.0, &truths, vec![events]);
        let found = of_label(&[&clip], 0, start.index()).unwrap();
        assert_eq!(found.missed, [0.5, 0.0, 0.0, 0.0], "two alarms pass at one a minute, none at 0.15");
        assert!((found.alarms_per_min - 1.0).abs() < 1e-12);
        assert!((found.overlap - (2.0 / 6.0 + 0.6) / 2.0).abs() < 1e-12);
        let turn = of_label(&[&clip], 0, left.index()).unwrap();
        assert_eq!(turn.missed, [1.0; 4]);
        assert!(turn.overlap.is_nan());
        assert_eq!(of_label(&[&clip], 0, Label::UTurn.index()), None);
    }

    #[test]
    fn an_event_that_need_not_be_found_is_neither_missed_nor_an_alarm() {
        let mut hidden = truth(1, Label::Starting, [0.0, 4.0]);
        hidden.counts = false;
        let seen = truth(2, Label::Starting, [0.0, 4.0]);
        let events = vec![
            reported(1, Label::Starting, [0.0, 2.0], 0.9),
            reported(1, Label::Starting, [2.0, 4.0], 0.9),
            reported(2, Label::Starting, [0.0, 4.0], 0.5),
        ];
        let clip = ClipEvents::new(1.0, &[hidden, seen], vec![events]);
        let found = of_label(&[&clip], 0, Label::Starting.index()).unwrap();
        assert_eq!((found.missed, found.alarms_per_min), ([0.0; 4], 0.0));
    }
}
