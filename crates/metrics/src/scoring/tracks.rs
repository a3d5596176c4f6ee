//! Scores the tracks of a clip: identities on the ground, and errors of position, motion and jitter.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector2;
use roadplane_base::{Activity, TrackRow};

use crate::motion::{MotionError, jitter_m, motion_error};
use crate::position::{PositionError, position_errors};
use crate::sequence::{Sequence, SequenceFrame, ZERO_DISTANCE_M};
use crate::truth::{TrueCar, Truth};

use super::{is_seen, pairs_by_box};

/// Largest distance between an interpolated row and its true car, m.
const NEAR_M: f64 = 2.0;

/// The scores of a clip's tracks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackScore {
    /// True and estimated positions on the ground: the input of HOTA, CLEAR MOT and IDF1.
    pub sequence: Sequence,
    /// True and estimated positions, after all estimated positions are multiplied by one scale factor. The factor is
    /// the one that fits them best to the true positions.
    ///
    /// The factor removes a common error of scale. Such an error arises because the size of the cars at a site is
    /// unknown.
    pub fitted: Sequence,
    /// Number of different vehicles that are visible enough ([`is_seen`]) in at least one frame.
    pub vehicles: usize,
    /// Number of vehicles that are visible enough ([`is_seen`]), summed over all frames.
    pub true_cars: usize,
    /// Position errors of all pairs of a vehicle and a row. In each frame, vehicles and rows are paired by the overlap
    /// of their boxes.
    pub positions: Vec<PositionError>,
    /// True distance (m) and normalised errors of each pair of a vehicle and a row. The errors in x and y are divided
    /// by the row's standard deviations.
    pub whitened: Vec<(f64, [f64; 2])>,
    /// Speed and heading errors. There is one entry for each row of a track that was matched with a true vehicle.
    pub motions: Vec<MotionError>,
    /// Jitter of the parked cars: the root mean square displacement between consecutive frames, m. Each unbroken part
    /// of a track has one value.
    pub jitters_m: Vec<f64>,
}

/// Scores the rows of `tracks.*` against the truth. `analysed` returns whether a frame was processed, given its number
/// and time (s).
///
/// The fields `sequence` and `fitted` of the result leave out two kinds of rows. The first kind belongs to a true car
/// that is hardly visible (see [`is_seen`]). The second kind is interpolated, and has no true car nearby. Such rows are
/// no false alarms: the truth lacks hidden cars, but their tracks continue with interpolated rows.
#[must_use]
pub fn score_tracks(truth: &Truth, rows: &[TrackRow], analysed: impl Fn(u64, f64) -> bool) -> TrackScore {
    let mut of_frame: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows {
        of_frame.entry(row.frame).or_default().push(row);
    }
    let parked = always_parked(truth);
    let mut score = TrackScore::default();
    // Positions of the rows of each parked car, by the id of the car.
    let mut parked_positions: BTreeMap<u64, Vec<ParkedPosition>> = BTreeMap::new();
    let (mut positions, mut ids_with_row) = (Vec::new(), BTreeSet::new());
    let mut frames: Vec<GroundFrame> = Vec::new();
    let processed = truth.frames.iter().filter(|frame| analysed(frame.frame, frame.time_s));
    for (index, frame) in processed.enumerate() {
        let rows = of_frame.get(&frame.frame).map_or(&[][..], Vec::as_slice);
        let cars: Vec<&TrueCar> = frame.cars.iter().filter(|car| is_seen(car)).collect();
        score.true_cars += cars.len();
        let kept = kept_rows(rows, &frame.cars, is_seen);
        frames.push(GroundFrame {
            truth: cars.iter().map(|car| (car.id, true_position(car))).collect(),
            found: kept.iter().map(|row| (row.track, position(row))).collect(),
        });

        let boxes: Vec<[f64; 4]> = rows.iter().map(|row| row.bbox_px).collect();
        for (row, car) in rows.iter().zip(pairs_by_box(&boxes, &cars)) {
            let Some(car) = car.map(|c| cars[c]) else { continue };
            positions.push((Some(position(row)), true_position(car)));
            ids_with_row.insert(car.id);
            let off = position(row) - true_position(car);
            score.whitened.push((true_position(car).norm(), [off.x / row.x_sd_m, off.y / row.y_sd_m]));
            let heading = car.world_from_car[1][0].atan2(car.world_from_car[0][0]);
            score.motions.push(motion_error(row.speed_mps, row.heading_rad, car.speed_mps, heading));
            if parked.contains(&car.id) {
                let of_car = parked_positions.entry(car.id).or_default();
                of_car.push(ParkedPosition { index, track: row.track, position: position(row) });
            }
        }
    }
    score.positions = position_errors(&positions, ids_with_row.len());
    let ids: BTreeSet<u64> = frames.iter().flat_map(|frame| &frame.truth).map(|(id, _)| *id).collect();
    score.vehicles = ids.len();
    let scale = scale_of(&positions);
    score.sequence = frames.iter().map(|frame| frame.scaled(1.0)).collect();
    score.fitted = frames.iter().map(|frame| frame.scaled(scale)).collect();
    for of_car in parked_positions.values() {
        let consecutive =
            |a: &ParkedPosition, b: &ParkedPosition| b.index == a.index + 1 && a.track == b.track;
        for interval in of_car.chunk_by(consecutive) {
            let positions: Vec<Vector2<f64>> = interval.iter().map(|parked| parked.position).collect();
            score.jitters_m.extend(jitter_m(&positions));
        }
    }
    score
}

/// True and estimated positions of one frame (m), with the ids of their vehicles and tracks.
struct GroundFrame {
    truth: Vec<(u64, Vector2<f64>)>,
    found: Vec<(u64, Vector2<f64>)>,
}

impl GroundFrame {
    fn scaled(&self, scale: f64) -> SequenceFrame {
        let found: Vec<_> = self.found.iter().map(|(id, position)| (*id, position * scale)).collect();
        SequenceFrame::on_ground(&self.truth, &found)
    }
}

/// Returns the scale factor that fits the estimated positions best to the true ones, by least squares. The centre of
/// the scale is the camera's foot point. Positions with gross errors are left out.
fn scale_of(positions: &[(Option<Vector2<f64>>, Vector2<f64>)]) -> f64 {
    let mut scale = 1.0;
    // The first rounds allow for the usual error of the scale. The last rounds do not.
    for share in [0.2, 0.1, 0.0, 0.0] {
        let (mut products, mut squares) = (0.0, 0.0);
        for (found, truth) in positions.iter().filter_map(|(found, truth)| Some(((*found)?, truth))) {
            if (found * scale - truth).norm() < ZERO_DISTANCE_M.max(share * truth.norm()) {
                products += found.dot(truth);
                squares += found.norm_squared();
            }
        }
        if squares > 0.0 {
            scale = products / squares;
        }
    }
    scale
}

/// The position of a parked car's row in one frame.
struct ParkedPosition {
    /// Index of the frame among the processed frames.
    index: usize,
    track: u64,
    position: Vector2<f64>,
}

fn position(row: &TrackRow) -> Vector2<f64> {
    Vector2::new(row.x_m, row.y_m)
}

fn true_position(car: &TrueCar) -> Vector2<f64> {
    Vector2::new(car.world_from_car[0][3], car.world_from_car[1][3])
}

fn always_parked(truth: &Truth) -> BTreeSet<u64> {
    let cars = || truth.frames.iter().flat_map(|frame| &frame.cars);
    let moved: BTreeSet<u64> =
        cars().filter(|car| car.activity != Activity::Parked).map(|car| car.id).collect();
    cars().map(|car| car.id).filter(|id| !moved.contains(id)).collect()
}

/// Returns the rows of a frame that [`score_tracks`] puts into its sequences. The car of a row is the true car that
/// overlaps the row's box in the picture.
fn kept_rows<'a>(
    rows: &[&'a TrackRow],
    cars: &[TrueCar],
    counted: impl Fn(&TrueCar) -> bool,
) -> Vec<&'a TrackRow> {
    let boxes: Vec<[f64; 4]> = rows.iter().map(|row| row.bbox_px).collect();
    let car_of = pairs_by_box(&boxes, &cars.iter().collect::<Vec<_>>());
    let near = |row: &TrackRow| cars.iter().any(|car| (position(row) - true_position(car)).norm() < NEAR_M);
    let keep = |(row, car): (&&'a TrackRow, &Option<usize>)| match car {
        Some(car) => counted(&cars[*car]).then_some(*row),
        None => (row.observed || near(row)).then_some(*row),
    };
    rows.iter().zip(&car_of).filter_map(keep).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::fixture::lot;
    use crate::{clear::Clear, hota::HotaCounts};

    /// Returns rows with the true positions shifted by `dx` m to the right.
    fn rows(truth: &Truth, dx: f64) -> Vec<TrackRow> {
        let row = |frame: &crate::truth::TrueFrame, car: &TrueCar| TrackRow {
            x_m: true_position(car).x + dx,
            y_m: true_position(car).y,
            heading_rad: car.world_from_car[1][0].atan2(car.world_from_car[0][0]),
            speed_mps: car.speed_mps + 0.25,
            y_sd_m: 0.1,
            heading_sd_rad: 0.1,
            bbox_px: car.bbox_px,
            ..roadplane_synth::stationary_row(car.id + 1, frame.frame, frame.time_s)
        };
        truth.frames.iter().flat_map(|frame| frame.cars.iter().map(move |car| row(frame, car))).collect()
    }

    #[test]
    fn errors_equal_those_of_the_rows() {
        let truth = lot(4);
        let mut rows = rows(&truth, 0.3);
        // The first parked car jumps 0.2 m for one of the four frames. Its steps are 0, 0.2 and 0.2 m.
        rows[6].y_m += 0.2;
        let score = score_tracks(&truth, &rows, |_, _| true);
        assert_eq!((score.true_cars, score.positions.len(), score.vehicles), (12, 12, 3));
        // The standard deviations are 0.1 m.
        assert!((score.whitened[0].1[0] - 3.0).abs() < 1e-6 && score.whitened[0].1[1].abs() < 1e-6);
        assert!((score.positions[0].error_m - 0.3).abs() < 1e-9);
        assert!(score.motions.iter().all(|m| (m.speed_mps - 0.25).abs() < 1e-9 && m.heading_rad < 1e-9));
        assert_eq!(score.jitters_m.len(), 2, "the passing car is not parked");
        assert!((score.jitters_m[0] - (0.08f64 / 3.0).sqrt()).abs() < 1e-9 && score.jitters_m[1] < 1e-9);
        assert!((Clear::of(&score.sequence).mota() - 1.0).abs() < 1e-12);
        // An error of 0.3 m is a similarity of 0.925, which passes 18 of 19 thresholds. An error of 0.36 m passes the
        // same thresholds.
        assert!((HotaCounts::of(&score.sequence).score().ass_a - 18.0 / 19.0).abs() < 1e-12);
    }

    #[test]
    fn an_unknown_scale_is_removed() {
        let truth = lot(4);
        let mut rows = rows(&truth, 0.0);
        for row in &mut rows {
            (row.x_m, row.y_m) = (1.12 * row.x_m, 1.12 * row.y_m);
        }
        // One row is far off and does not change the scale.
        rows[0].x_m += 40.0;
        let score = score_tracks(&truth, &rows, |_, _| true);
        let hota = |sequence| HotaCounts::of(sequence).score().hota;
        assert!(hota(&score.sequence) < 0.6, "{}", hota(&score.sequence));
        // The distant row is a miss and a false alarm, so 11 of 13 objects remain.
        assert!(hota(&score.fitted) > 0.84, "{}", hota(&score.fitted));
    }

    #[test]
    fn cars_that_do_not_count_cost_nothing() {
        let mut truth = lot(2);
        let mut rows = rows(&truth, 0.0);
        for frame in &mut truth.frames {
            frame.cars[1].visible_share = 0.2;
        }
        // An interpolated row far from all true cars is left out. The same row marked as observed is a false alarm.
        let bbox_px = [1.0, 1.0, 30.0, 20.0];
        let mut filled = TrackRow { track: 9, x_m: 30.0, bbox_px, observed: false, ..rows[0].clone() };
        rows.push(filled.clone());
        let score = Clear::of(&score_tracks(&truth, &rows, |_, _| true).sequence);
        assert_eq!((score.hits, score.misses, score.false_alarms), (4, 0, 0));
        filled.observed = true;
        rows.push(filled);
        let score = Clear::of(&score_tracks(&truth, &rows, |_, _| true).sequence);
        assert_eq!((score.hits, score.false_alarms), (4, 1));
    }
}
