//! Tracks of a clip: identity on the ground; position, motion and jitter of those found.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector2;
use roadplane_base::{Activity, TrackRow};

use crate::motion::{MotionError, jitter_m, motion_error};
use crate::position::{PositionError, position_errors};
use crate::sequence::{Sequence, SequenceFrame, ZERO_DISTANCE_M};
use crate::truth::{TrueCar, Truth};

use super::{is_seen, pairs_by_box};

/// A row that was filled in this near a true car is meant to be that car, m.
const NEAR_M: f64 = 2.0;

/// What tracks are worth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackScore {
    /// For HOTA, CLEAR MOT and IDF1.
    pub sequence: Sequence,
    /// The same after the one scale that lays the found places best over the true ones: how large a place's cars are is not known.
    pub fitted: Sequence,
    /// Vehicles that count in some frame.
    pub vehicles: usize,
    /// Vehicles (vehicle and frame) that count.
    pub true_cars: usize,
    /// Position errors of those that a row's box overlaps.
    pub positions: Vec<PositionError>,
    /// True distance, m, and error in x and y as multiples of the row's sd, of the same.
    pub whitened: Vec<(f64, [f64; 2])>,
    /// Speed and heading errors of the same.
    pub motions: Vec<MotionError>,
    /// Of each parked car: RMS step from frame to frame, m.
    pub jitters_m: Vec<f64>,
}

/// Scores the rows of `tracks.*` in the frames that `analysed` says were looked at.
///
/// Left out are rows whose box is that of a true car of which too little is seen (see [`is_seen`]), and rows that were filled in where
/// truth lists no car within reach: truth leaves out cars that are hidden, which is when rows are filled in.
#[must_use]
pub fn score_tracks(truth: &Truth, rows: &[TrackRow], analysed: impl Fn(u64, f64) -> bool) -> TrackScore {
    let mut of_frame: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in rows {
        of_frame.entry(row.frame).or_default().push(row);
    }
    let parked = always_parked(truth);
    let mut score = TrackScore::default();
    // Places of parked cars in consecutive frames under one track.
    let mut stands: BTreeMap<u64, Vec<Stand>> = BTreeMap::new();
    let (mut places, mut placed) = (Vec::new(), BTreeSet::new());
    let mut frames: Vec<GroundFrame> = Vec::new();
    let looked_at = truth.frames.iter().filter(|frame| analysed(frame.frame, frame.time_s));
    for (place_in_clip, frame) in looked_at.enumerate() {
        let rows = of_frame.get(&frame.frame).map_or(&[][..], Vec::as_slice);
        let cars: Vec<&TrueCar> = frame.cars.iter().filter(|car| is_seen(car)).collect();
        score.true_cars += cars.len();
        let kept = kept_rows(rows, &frame.cars, is_seen);
        frames.push(GroundFrame {
            truth: cars.iter().map(|car| (car.id, true_place(car))).collect(),
            found: kept.iter().map(|row| (row.track, place(row))).collect(),
        });

        let boxes: Vec<[f64; 4]> = rows.iter().map(|row| row.bbox_px).collect();
        for (row, car) in rows.iter().zip(pairs_by_box(&boxes, &cars)) {
            let Some(car) = car.map(|c| cars[c]) else { continue };
            places.push((Some(place(row)), true_place(car)));
            placed.insert(car.id);
            let off = place(row) - true_place(car);
            score.whitened.push((true_place(car).norm(), [off.x / row.x_sd_m, off.y / row.y_sd_m]));
            let heading = car.world_from_car[1][0].atan2(car.world_from_car[0][0]);
            score.motions.push(motion_error(row.speed_mps, row.heading_rad, car.speed_mps, heading));
            if parked.contains(&car.id) {
                let stands = stands.entry(car.id).or_default();
                stands.push(Stand { place_in_clip, track: row.track, place: place(row) });
            }
        }
    }
    score.positions = position_errors(&places, placed.len());
    let ids: BTreeSet<u64> = frames.iter().flat_map(|frame| &frame.truth).map(|(id, _)| *id).collect();
    score.vehicles = ids.len();
    let scale = scale_of(&places);
    score.sequence = frames.iter().map(|frame| frame.scaled(1.0)).collect();
    score.fitted = frames.iter().map(|frame| frame.scaled(scale)).collect();
    for stands in stands.values() {
        let goes_on = |a: &Stand, b: &Stand| b.place_in_clip == a.place_in_clip + 1 && a.track == b.track;
        for stretch in stands.chunk_by(goes_on) {
            let places: Vec<Vector2<f64>> = stretch.iter().map(|stand| stand.place).collect();
            score.jitters_m.extend(jitter_m(&places));
        }
    }
    score
}

/// True and found places of a frame that count.
struct GroundFrame {
    truth: Vec<(u64, Vector2<f64>)>,
    found: Vec<(u64, Vector2<f64>)>,
}

impl GroundFrame {
    fn scaled(&self, scale: f64) -> SequenceFrame {
        let found: Vec<_> = self.found.iter().map(|(id, place)| (*id, place * scale)).collect();
        SequenceFrame::on_ground(&self.truth, &found)
    }
}

/// Scale about the camera's foot that brings found places to the true ones with the least squares; wrong ones have no say.
fn scale_of(places: &[(Option<Vector2<f64>>, Vector2<f64>)]) -> f64 {
    let mut scale = 1.0;
    // First within the share by which scales are wrong, then within reach.
    for share in [0.2, 0.1, 0.0, 0.0] {
        let (mut products, mut squares) = (0.0, 0.0);
        for (found, truth) in places.iter().filter_map(|(found, truth)| Some(((*found)?, truth))) {
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

struct Stand {
    place_in_clip: usize,
    track: u64,
    place: Vector2<f64>,
}

fn place(row: &TrackRow) -> Vector2<f64> {
    Vector2::new(row.x_m, row.y_m)
}

fn true_place(car: &TrueCar) -> Vector2<f64> {
    Vector2::new(car.world_from_car[0][3], car.world_from_car[1][3])
}

fn always_parked(truth: &Truth) -> BTreeSet<u64> {
    let cars = || truth.frames.iter().flat_map(|frame| &frame.cars);
    let moved: BTreeSet<u64> =
        cars().filter(|car| car.activity != Activity::Parked).map(|car| car.id).collect();
    cars().map(|car| car.id).filter(|id| !moved.contains(id)).collect()
}

/// Rows that count: see [`score_tracks`]. Which car a row is of is decided in the picture, as everywhere.
fn kept_rows<'a>(
    rows: &[&'a TrackRow],
    cars: &[TrueCar],
    counted: impl Fn(&TrueCar) -> bool,
) -> Vec<&'a TrackRow> {
    let boxes: Vec<[f64; 4]> = rows.iter().map(|row| row.bbox_px).collect();
    let car_of = pairs_by_box(&boxes, &cars.iter().collect::<Vec<_>>());
    let near = |row: &TrackRow| cars.iter().any(|car| (place(row) - true_place(car)).norm() < NEAR_M);
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

    /// Rows that say what is true, `dx` m to the right of it.
    fn rows(truth: &Truth, dx: f64) -> Vec<TrackRow> {
        let row = |frame: &crate::truth::TrueFrame, car: &TrueCar| TrackRow {
            x_m: true_place(car).x + dx,
            y_m: true_place(car).y,
            heading_rad: car.world_from_car[1][0].atan2(car.world_from_car[0][0]),
            speed_mps: car.speed_mps + 0.25,
            y_sd_m: 0.1,
            heading_sd_rad: 0.1,
            bbox_px: car.bbox_px,
            ..roadplane_synth::standing(car.id + 1, frame.frame, frame.time_s)
        };
        truth.frames.iter().flat_map(|frame| frame.cars.iter().map(move |car| row(frame, car))).collect()
    }

    #[test]
    fn errors_are_those_put_in() {
        let truth = lot(4);
        let mut rows = rows(&truth, 0.3);
        // The first parked car jumps 0.2 m for one of the four frames: steps 0, 0.2, 0.2.
        rows[6].y_m += 0.2;
        let score = score_tracks(&truth, &rows, |_, _| true);
        assert_eq!((score.true_cars, score.positions.len(), score.vehicles), (12, 12, 3));
        // sds are 0.1 m.
        assert!((score.whitened[0].1[0] - 3.0).abs() < 1e-6 && score.whitened[0].1[1].abs() < 1e-6);
        assert!((score.positions[0].error_m - 0.3).abs() < 1e-9);
        assert!(score.motions.iter().all(|m| (m.speed_mps - 0.25).abs() < 1e-9 && m.heading_rad < 1e-9));
        assert_eq!(score.jitters_m.len(), 2, "the passing car is not parked");
        assert!((score.jitters_m[0] - (0.08f64 / 3.0).sqrt()).abs() < 1e-9 && score.jitters_m[1] < 1e-9);
        assert!((Clear::of(&score.sequence).mota() - 1.0).abs() < 1e-12);
        // 0.3 m of 4 m: similarity 0.925 passes 18 of 19 thresholds; so do 0.36 m.
        assert!((HotaCounts::of(&score.sequence).score().ass_a - 18.0 / 19.0).abs() < 1e-12);
    }

    #[test]
    fn a_scale_that_nobody_knows_is_taken_out() {
        let truth = lot(4);
        let mut rows = rows(&truth, 0.0);
        for row in &mut rows {
            (row.x_m, row.y_m) = (1.12 * row.x_m, 1.12 * row.y_m);
        }
        // One row is far off and has no say.
        rows[0].x_m += 40.0;
        let score = score_tracks(&truth, &rows, |_, _| true);
        let hota = |sequence| HotaCounts::of(sequence).score().hota;
        assert!(hota(&score.sequence) < 0.6, "{}", hota(&score.sequence));
        // That row is a miss and a false alarm: 11 of 13.
        assert!(hota(&score.fitted) > 0.84, "{}", hota(&score.fitted));
    }

    #[test]
    fn what_does_not_count_costs_nothing() {
        let mut truth = lot(2);
        let mut rows = rows(&truth, 0.0);
        for frame in &mut truth.frames {
            frame.cars[1].visible_share = 0.2;
        }
        // A row that was filled in where truth lists nobody; the same seen is a false alarm.
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
