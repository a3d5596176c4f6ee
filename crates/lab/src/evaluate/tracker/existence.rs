//! Reliability of the probability that a track is a vehicle.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use roadplane_base::{TrackRow, bbox_iou};
use roadplane_metrics::truth::Truth;
use roadplane_tables::{Cell, Column, Table};
use roadplane_track::{Evidence, FEATURES};

/// Least overlap (IoU) of a row's box with the box of a vehicle that it shows. Boxes of hidden vehicles are rough.
const MIN_IOU: f64 = 0.35;
/// Number of bins of the probability.
const BINS: usize = 10;

/// A track whose truth is known.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    /// Number of the track.
    track: u64,
    /// Whether it is a vehicle: most of its observed rows show one.
    is_vehicle: bool,
    /// All that the tracker knows of it.
    evidence: Evidence,
}

/// Compares the tracks of a clip with its true vehicles.
pub(super) fn candidates(
    truth: &Truth,
    rows: &[TrackRow],
    evidence: &BTreeMap<u64, Evidence>,
) -> Vec<Candidate> {
    let frames: BTreeMap<u64, _> = truth.frames.iter().map(|frame| (frame.frame, &frame.cars)).collect();
    // Number of observed rows of each track, and of those that show a vehicle.
    let mut counts: BTreeMap<u64, [usize; 2]> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.observed) {
        let Some(cars) = frames.get(&row.frame) else { continue };
        let is_of = |truth: &[f64; 4]| bbox_iou(&row.bbox_px, truth) >= MIN_IOU;
        let is_true = cars.iter().any(|car| is_of(&car.bbox_px) || is_of(&car.whole_bbox_px));
        let [all, shown] = counts.entry(row.track).or_default();
        *all += 1;
        *shown += usize::from(is_true);
    }
    let candidate = |(track, [all, shown]): (u64, [usize; 2])| {
        Some(Candidate { track, is_vehicle: 2 * shown > all, evidence: *evidence.get(&track)? })
    };
    counts.into_iter().filter_map(candidate).collect()
}

/// Returns the table of predicted and true shares of vehicles.
pub(super) fn reliability_table(all: &[Candidate]) -> Table {
    let columns = [("mean probability, %", 1), ("vehicles, %", 1), ("difference in sds", 1)];
    let mut table = Table::new(
        "Probability that a track is a vehicle",
        "A track is a vehicle if most of its observed rows show one (IoU from 0.35 on). Sds: of a binomial distribution \
         with the mean probability. Only reported tracks count; track.min_exists_p=0 reports all.",
        [Column::new("probability", 0), Column::new("tracks", 0)]
            .into_iter()
            .chain(columns.map(|(title, decimals)| Column::new(title, decimals)))
            .collect(),
    );
    let mut off = 0.0;
    for bin in 0..BINS {
        let [from, to] = [bin, bin + 1].map(|i| i as f64 / BINS as f64);
        let is_in = |p: f64| from <= p && (p < to || bin + 1 == BINS);
        let inside: Vec<(f64, f64)> = (all.iter())
            .map(|one| (one.evidence.probability(), f64::from(u8::from(one.is_vehicle))))
            .filter(|(p, _)| is_in(*p))
            .collect();
        let count = inside.len() as f64;
        if inside.is_empty() {
            continue;
        }
        let mean = inside.iter().map(|(p, _)| p).sum::<f64>() / count;
        let share = inside.iter().map(|(_, yes)| yes).sum::<f64>() / count;
        let sd = (mean * (1.0 - mean) / count).sqrt();
        off += (share - mean).abs() * count / all.len() as f64;
        table.rows.push(vec![
            Cell::from(format!("{from:.1}–{to:.1}")),
            count.into(),
            (100.0 * mean).into(),
            (100.0 * share).into(),
            ((share - mean) / sd.max(1e-9)).into(),
        ]);
    }
    table.note += &format!(" Expected calibration error: {off:.3}.");
    table
}

/// Returns the candidates of all clips as CSV, for `scripts/train/tracks`: clip, track, whether it is a vehicle, and the
/// features of the model.
pub(super) fn candidates_csv<'a>(clips: impl Iterator<Item = (&'a str, &'a [Candidate])>) -> String {
    let mut text = "clip,track,is_vehicle".to_owned();
    for feature in 0..FEATURES {
        let _infallible = write!(text, ",feature_{feature}");
    }
    text.push('\n');
    for (clip, candidates) in clips {
        for Candidate { track, is_vehicle, evidence } in candidates {
            let _infallible = write!(text, "{clip},{track},{}", u8::from(*is_vehicle));
            for feature in evidence.features() {
                let _infallible = write!(text, ",{feature}");
            }
            text.push('\n');
        }
    }
    text
}
