//! Reliability of the tracker's probabilities: that a track is a vehicle, and that a join is right.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use roadplane_base::{TrackRow, bbox_iou};
use roadplane_metrics::scoring::most_frequent;
use roadplane_metrics::truth::{TrueCar, Truth};
use roadplane_tables::{Cell, Column, Table};
use roadplane_track::Join;

use crate::systems::FusedClip;

/// Least overlap (IoU) of a row's box with the box of a vehicle that it shows. Boxes of hidden vehicles are rough.
const MIN_IOU: f64 = 0.35;
/// Length of the time beside a gap whose rows show the vehicle, s.
const BESIDE_S: f64 = 1.0;
/// Number of bins of the probability.
const BINS: usize = 10;

/// A statement of the tracker whose truth is known.
#[derive(Clone, Debug)]
pub(super) struct Claim {
    /// Number of the track.
    track: u64,
    /// Probability that the statement is true, 0–1.
    p: f64,
    /// Whether it is true.
    is_true: bool,
    /// Features of the probability's model.
    features: Vec<f64>,
}

/// Compares the tracks of a clip with its true vehicles. A track is a vehicle if most of its observed rows show one.
pub(super) fn existence_claims(truth: &Truth, clip: &FusedClip) -> Vec<Claim> {
    // Number of observed rows of each track, and of those that show a vehicle.
    let mut counts: BTreeMap<u64, [usize; 2]> = BTreeMap::new();
    for (row, vehicle) in shown(truth, &clip.rows) {
        let [all, shown] = counts.entry(row.track).or_default();
        *all += 1;
        *shown += usize::from(vehicle.is_some());
    }
    let claim = |(track, [all, shown]): (u64, [usize; 2])| {
        let evidence = clip.evidence.get(&track)?;
        let (p, features) = (evidence.probability(), evidence.features().to_vec());
        Some(Claim { track, p, is_true: 2 * shown > all, features })
    };
    counts.into_iter().filter_map(claim).collect()
}

/// Compares the joins of a clip's tracks with its true vehicles. A join is right if the rows of the last second before the
/// gap and of the first one after it mostly show the same vehicle. Rows without a vehicle count only if all others have
/// none, too: a box next to a gap often shows a part of the vehicle. Joins between rows that show no vehicle do not count.
pub(super) fn join_claims(truth: &Truth, clip: &FusedClip) -> Vec<Claim> {
    let mut vehicles: BTreeMap<u64, Vec<(f64, Option<u64>)>> = BTreeMap::new();
    for (row, vehicle) in shown(truth, &clip.rows) {
        vehicles.entry(row.track).or_default().push((row.time_s, vehicle));
    }
    let joins = clip.joins.iter().flat_map(|(track, joins)| joins.iter().map(move |join| (*track, join)));
    let claim = |(track, join): (u64, &Join)| {
        let rows = vehicles.get(&track)?;
        let before = vehicle_between(rows, join.from.time_s() - BESIDE_S, join.from.time_s())?;
        let after = vehicle_between(rows, join.to.time_s(), join.to.time_s() + BESIDE_S)?;
        before.or(after)?;
        let (p, features) = (join.same_vehicle_p(), join.features().to_vec());
        Some(Claim { track, p, is_true: before == after, features })
    };
    joins.filter_map(claim).collect()
}

/// Returns the vehicle that the rows from time `from` to time `to` (s) show most often. `rows` has the time and the vehicle
/// of each row. The inner value is `None` if no row shows a vehicle, and the outer one without rows.
fn vehicle_between(rows: &[(f64, Option<u64>)], from: f64, to: f64) -> Option<Option<u64>> {
    let mut near = rows.iter().filter(|(time_s, _)| (from - 1e-6..=to + 1e-6).contains(time_s)).peekable();
    near.peek()?;
    Some(most_frequent(near.filter_map(|(_, vehicle)| *vehicle)))
}

/// Returns each observed row in a frame with truth, and the vehicle that it shows.
fn shown<'a>(truth: &Truth, rows: &'a [TrackRow]) -> impl Iterator<Item = (&'a TrackRow, Option<u64>)> {
    let frames: BTreeMap<u64, _> = truth.frames.iter().map(|frame| (frame.frame, &frame.cars)).collect();
    rows.iter().filter(|row| row.observed).filter_map(move |row| {
        let overlap = |car: &TrueCar| {
            bbox_iou(&row.bbox_px, &car.bbox_px).max(bbox_iou(&row.bbox_px, &car.whole_bbox_px))
        };
        let best = frames.get(&row.frame)?.iter().map(|car| (overlap(car), car.id));
        let best = best.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(overlap, _)| *overlap >= MIN_IOU);
        Some((row, best.map(|(_, id)| id)))
    })
}

/// Returns the table of predicted and true shares. `counted` names the claims, such as "tracks".
pub(super) fn reliability_table(title: &str, counted: &'static str, note: &str, all: &[Claim]) -> Table {
    let columns = [("mean probability, %", 1), ("true, %", 1), ("difference in sds", 1)];
    let mut table = Table::new(
        title,
        format!("{note} Sds: of a binomial distribution with the mean probability."),
        [Column::new("probability", 0), Column::new(counted, 0)]
            .into_iter()
            .chain(columns.map(|(title, decimals)| Column::new(title, decimals)))
            .collect(),
    );
    let mut off = 0.0;
    for bin in 0..BINS {
        let [from, to] = [bin, bin + 1].map(|i| i as f64 / BINS as f64);
        let is_in = |p: f64| from <= p && (p < to || bin + 1 == BINS);
        let inside: Vec<(f64, f64)> = (all.iter())
            .map(|claim| (claim.p, f64::from(u8::from(claim.is_true))))
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

/// Returns the claims of all clips as CSV, for `scripts/train/tracks`: clip, track, whether the claim is true, and the
/// features of the model.
pub(super) fn claims_csv<'a>(clips: impl Iterator<Item = (&'a str, &'a [Claim])>) -> String {
    let mut text = String::new();
    for (clip, claims) in clips {
        for Claim { track, is_true, features, .. } in claims {
            if text.is_empty() {
                text.push_str("clip,track,is_true");
                (0..features.len()).for_each(|feature| {
                    let _infallible = write!(text, ",feature_{feature}");
                });
                text.push('\n');
            }
            let _infallible = write!(text, "{clip},{track},{}", u8::from(*is_true));
            for feature in features {
                let _infallible = write!(text, ",{feature}");
            }
            text.push('\n');
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_rows_near_a_gap_name_the_vehicle() {
        let rows = [
            (0.2, Some(5)),
            (2.0, Some(7)),
            (2.1, Some(7)),
            (2.2, Some(3)),
            (2.3, None),
            (2.4, None),
            (2.5, None),
        ];
        assert_eq!(vehicle_between(&rows, 1.5, 2.5), Some(Some(7)));
        assert_eq!(vehicle_between(&rows, 2.2, 2.5), Some(Some(3)), "one row that shows a vehicle is enough");
        assert_eq!(vehicle_between(&rows, 2.3, 2.5), Some(None));
        assert_eq!(vehicle_between(&rows, 1.0, 1.5), None);
    }
}
