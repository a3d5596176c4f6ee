//! Intervals in which a track was not detected.

use roadplane_base::TrackRow;

/// A vehicle that was not detected for longer than this was hidden, s. Shorter gaps lie between two inference frames.
const HIDDEN_S: f64 = 1.0;

/// Returns the intervals between two detections of a track in which the vehicle was hidden, s.
pub(super) fn hidden_intervals(rows: &[&TrackRow]) -> Vec<[f64; 2]> {
    let detected: Vec<f64> = rows.iter().filter(|row| row.observed).map(|row| row.time_s).collect();
    detected.windows(2).filter(|pair| pair[1] - pair[0] > HIDDEN_S).map(|pair| [pair[0], pair[1]]).collect()
}
