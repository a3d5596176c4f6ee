//! Intervals in which the vehicle of a track was not detected.

use roadplane_base::TrackRow;

/// Time between two detections above which a vehicle counts as hidden, s. Shorter gaps are normal, because the detector
/// does not run on every frame.
const HIDDEN_S: f64 = 1.0;

/// Returns the intervals in which the vehicle of a track was hidden, s. Each interval starts and ends with a detection.
pub(super) fn hidden_intervals(rows: &[&TrackRow]) -> Vec<[f64; 2]> {
    let detected: Vec<f64> = rows.iter().filter(|row| row.observed).map(|row| row.time_s).collect();
    detected.windows(2).filter(|pair| pair[1] - pair[0] > HIDDEN_S).map(|pair| [pair[0], pair[1]]).collect()
}
