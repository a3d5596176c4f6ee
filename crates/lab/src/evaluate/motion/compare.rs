//! Compares the run on a film with motion against the run on the film at rest.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Complex;
use roadplane_base::{ImageSize, TrackRow, bbox_iou};

/// Least IoU of the boxes of one vehicle in the two runs.
const SAME: f64 = 0.3;
/// Distance within which places are compared in metres, m. Beyond it, they are compared in units of their sds.
const NEAR_M: f64 = 60.0;
/// Least share of a box that must lie in the picture.
const IN_VIEW: f64 = 0.95;
/// Frames between two runs of the keypoint net on a vehicle, at most. A row counts as observed if a row so near is.
const KEYPOINT_STRIDE: u64 = 2;

/// Differences between the rows of two runs.
pub(super) struct Difference {
    /// Number of tracks at rest with observed rows in view of the other run.
    pub tracks_in_view: usize,
    /// Share of the observed rows at rest that are also observed in the other run.
    pub observed: f64,
    /// Rms distance of the places within [`NEAR_M`], m.
    pub near_m: f64,
    /// Rms distance of the places beyond [`NEAR_M`], in units of their sds at rest.
    pub far_sds: f64,
}

/// Rows of a run by frame.
pub(super) struct Rows<'a>(BTreeMap<u64, Vec<&'a TrackRow>>);

impl<'a> Rows<'a> {
    /// Sorts rows by frame.
    pub fn new(rows: &'a [TrackRow]) -> Self {
        let mut by_frame: BTreeMap<u64, Vec<&TrackRow>> = BTreeMap::new();
        for row in rows {
            by_frame.entry(row.frame).or_default().push(row);
        }
        Self(by_frame)
    }

    fn at(&self, frame: u64) -> &[&'a TrackRow] {
        self.0.get(&frame).map_or(&[], Vec::as_slice)
    }

    /// Whether a track is observed in a frame, or so near to it that the keypoint net did not run again.
    fn is_observed(&self, track: u64, frame: u64) -> bool {
        let near = self.0.range(frame.saturating_sub(KEYPOINT_STRIDE)..=frame + KEYPOINT_STRIDE);
        near.flat_map(|(_, rows)| rows).any(|row| row.track == track && row.observed)
    }

    /// Compares the rows at rest (`self`) with those of a moving film. `size` is the size of its pictures. The function
    /// `change` converts a box of a frame at rest to the same frame of the moving film, px.
    pub fn compare(
        &self,
        moving: &Rows<'_>,
        size: ImageSize,
        change: impl Fn(u64, &[f64; 4]) -> [f64; 4],
    ) -> Difference {
        let (mut in_view, mut found) = (0_usize, 0_usize);
        let mut tracks_in_view = BTreeSet::new();
        let mut pairs: Vec<(&TrackRow, &TrackRow)> = Vec::new();
        for (&frame, rows) in &self.0 {
            for row in rows.iter().filter(|row| row.observed) {
                let bbox_px = change(frame, &row.bbox_px);
                if share_inside(&bbox_px, size) < IN_VIEW {
                    continue;
                }
                in_view += 1;
                tracks_in_view.insert(row.track);
                let overlap = |other: &&TrackRow| bbox_iou(&other.bbox_px, &bbox_px);
                let best = moving.at(frame).iter().copied().max_by(|a, b| overlap(a).total_cmp(&overlap(b)));
                if let Some(best) = best.filter(|best| overlap(best) >= SAME) {
                    found += usize::from(moving.is_observed(best.track, frame));
                    pairs.push((row, best));
                }
            }
        }
        let place = |row: &TrackRow| Complex::new(row.x_m, row.y_m);
        // The world axes are those of the first picture, whose direction differs.
        let turn = pairs.iter().map(|(rest, moved)| place(rest) * place(moved).conj()).sum::<Complex<f64>>();
        let turn = turn / turn.norm().max(f64::MIN_POSITIVE);
        let away_m = |(rest, moved): &(&TrackRow, &TrackRow)| (place(moved) * turn - place(rest)).norm();
        let (near, far): (Vec<_>, Vec<_>) =
            pairs.into_iter().partition(|(rest, _)| place(rest).norm() <= NEAR_M);
        let rms = |values: Vec<f64>| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
        Difference {
            tracks_in_view: tracks_in_view.len(),
            observed: found as f64 / in_view as f64,
            near_m: rms(near.iter().map(away_m).collect()),
            far_sds: rms(far.iter().map(|pair| away_m(pair) / pair.0.x_sd_m.hypot(pair.0.y_sd_m)).collect()),
        }
    }
}

fn share_inside(bbox_px: &[f64; 4], size: ImageSize) -> f64 {
    let [x0, y0, x1, y1] = bbox_px;
    let [right, bottom] = [size.width, size.height].map(|side| f64::from(side) - 1.0);
    let inside = (x1.min(right) - x0.max(0.0)).max(0.0) * (y1.min(bottom) - y0.max(0.0)).max(0.0);
    inside / ((x1 - x0) * (y1 - y0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finished_run::track_count;
    use roadplane_synth::stationary_row;

    const SIZE: ImageSize = ImageSize { width: 640, height: 360 };

    fn row(frame: u64, track: u64, x_px: f64, x_m: f64) -> TrackRow {
        TrackRow {
            x_m,
            x_sd_m: 0.3,
            y_sd_m: 0.4,
            bbox_px: [x_px, 100.0, x_px + 60.0, 150.0],
            ..stationary_row(track, frame, frame as f64 * 0.04)
        }
    }

    #[test]
    fn rows_are_compared_in_view_and_without_the_direction_of_the_axes() {
        let rest: Vec<TrackRow> =
            (0..10).flat_map(|frame| [row(frame, 1, 200.0, 0.0), row(frame, 2, 20.0, -15.0)]).collect();
        // The picture moves to the left by 50 px, so the second vehicle leaves it. The axes turn by 90°.
        let moved: Vec<TrackRow> = (0..10)
            .map(|frame| TrackRow { x_m: -20.0, y_m: 0.0, observed: frame != 5, ..row(frame, 7, 150.0, 0.0) })
            .collect();
        let shift = |_, [x0, y0, x1, y1]: &[f64; 4]| [x0 - 50.0, *y0, x1 - 50.0, *y1];
        let found = Rows::new(&rest).compare(&Rows::new(&moved), SIZE, shift);
        assert_eq!((found.tracks_in_view, found.observed), (1, 1.0));
        assert!(found.near_m < 1e-9 && found.far_sds.is_nan(), "{}", found.near_m);
        let none = Rows::new(&rest).compare(&Rows::new(&[]), SIZE, shift);
        assert_eq!((none.tracks_in_view, none.observed), (1, 0.0));
        assert_eq!(track_count(&rest), 2);
    }
}
