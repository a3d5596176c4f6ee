//! Passings of rendered vehicles: pieces of a given length of their true paths.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::TrackRow;
use roadplane_metrics::scoring::{is_seen, pairs_by_box};
use roadplane_metrics::truth::{TrueCar, Truth};

use super::Passing;
use crate::finished_run::FinishedRun;

/// Least speed of a vehicle on a piece, m/s. Slower vehicles are stationary or manoeuvre.
const LEAST_MPS: f64 = 1.0;

/// A vehicle in one frame.
struct Seen {
    time_s: f64,
    place: Vector2<f64>,
    speed_mps: f64,
    /// Track whose box is that of the vehicle.
    track: Option<u64>,
}

/// Returns the pieces of `distance_m` of the true paths that were in view, with the tracks that follow them.
pub(super) fn passings(run: &FinishedRun, truth: &Truth, distance_m: f64) -> Vec<Passing> {
    let mut rows_of: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
    for row in &run.rows {
        rows_of.entry(row.frame).or_default().push(row);
    }
    let analysed = run.analysed(truth);
    let mut paths: BTreeMap<u64, Vec<Option<Seen>>> = BTreeMap::new();
    for frame in truth.frames.iter().filter(|frame| analysed.contains(&frame.frame)) {
        let cars: Vec<&TrueCar> = frame.cars.iter().filter(|car| is_seen(car)).collect();
        let rows = rows_of.get(&frame.frame).map_or(&[][..], Vec::as_slice);
        let boxes: Vec<[f64; 4]> = rows.iter().map(|row| row.bbox_px).collect();
        let mut track_of = vec![None; cars.len()];
        for (row, car) in rows.iter().zip(pairs_by_box(&boxes, &cars)) {
            if let Some(car) = car {
                track_of[car] = Some(row.track);
            }
        }
        for (car, track) in cars.iter().zip(track_of) {
            let place = Vector2::new(car.world_from_car[0][3], car.world_from_car[1][3]);
            let seen = Seen { time_s: frame.time_s, place, speed_mps: car.speed_mps.abs(), track };
            paths.entry(car.id).or_default().push(Some(seen));
        }
        // A vehicle that is hidden or out of view ends its piece.
        for (id, path) in &mut paths {
            if !cars.iter().any(|car| car.id == *id) {
                path.push(None);
            }
        }
    }
    paths.values().flat_map(|path| pieces(path, distance_m)).collect()
}

/// Cuts a vehicle's path into pieces of a given length, m. A frame without the vehicle, or a slow one, starts anew.
fn pieces(path: &[Option<Seen>], distance_m: f64) -> Vec<Passing> {
    let mut found = Vec::new();
    let mut open: Vec<&Seen> = Vec::new();
    let mut length_m = 0.0;
    for seen in path {
        let Some(seen) = seen.as_ref().filter(|seen| seen.speed_mps >= LEAST_MPS) else {
            (open, length_m) = (Vec::new(), 0.0);
            continue;
        };
        if let Some(last) = open.last() {
            length_m += (seen.place - last.place).norm();
        }
        open.push(seen);
        if length_m >= distance_m {
            let span_s = [open[0].time_s, seen.time_s];
            found.push(Passing { span_s, distance_m: length_m, track: track_of(&open) });
            (open, length_m) = (vec![seen], 0.0);
        }
    }
    found
}

/// Returns the track that follows a vehicle in at least half of the frames.
fn track_of(piece: &[&Seen]) -> Option<u64> {
    let mut frames: BTreeMap<u64, usize> = BTreeMap::new();
    for track in piece.iter().filter_map(|seen| seen.track) {
        *frames.entry(track).or_default() += 1;
    }
    let most = frames.into_iter().max_by_key(|(track, count)| (*count, std::cmp::Reverse(*track)));
    most.filter(|(_, count)| 2 * count >= piece.len()).map(|(track, _)| track)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(time_s: f64, x: f64, track: Option<u64>) -> Option<Seen> {
        Some(Seen { time_s, place: Vector2::new(x, 0.0), speed_mps: 10.0, track })
    }

    #[test]
    fn a_path_is_cut_into_pieces() {
        let mut path: Vec<Option<Seen>> =
            (0..60).map(|i| seen(0.1 * f64::from(i), f64::from(i), Some(u64::from(i > 30)))).collect();
        let found = pieces(&path, 20.0);
        assert_eq!(found.len(), 2);
        assert!((found[0].span_s[1] - 2.0).abs() < 1e-9 && (found[0].distance_m - 20.0).abs() < 1e-9);
        assert_eq!((found[0].track, found[1].track), (Some(0), Some(0)));
        // After a frame without the vehicle, the next piece starts anew.
        path[15] = None;
        let found = pieces(&path, 20.0);
        assert!((found[0].span_s[0] - 1.6).abs() < 1e-9, "{found:?}");
        let lost: Vec<Option<Seen>> = (0..30).map(|i| seen(0.1 * f64::from(i), f64::from(i), None)).collect();
        assert_eq!(pieces(&lost, 20.0)[0].track, None);
    }
}
