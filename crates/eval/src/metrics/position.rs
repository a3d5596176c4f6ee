//! Position error on the ground by distance from the camera.

use nalgebra::Vector2;

/// Lower edges of the distance bins, m; the last bin has no upper edge.
pub const BIN_EDGES_M: [f64; 5] = [0.0, 20.0, 40.0, 60.0, 80.0];

/// Error of an estimated position and where it happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionError {
    /// True distance from the camera's foot on the ground, m.
    pub distance_m: f64,
    /// Length of the error on the ground, m.
    pub error_m: f64,
}

/// Error between an estimated and a true position, each in its own world (x right, y ahead of the camera, origin at its
/// foot), so that errors of the estimated camera count; m.
#[must_use]
pub fn position_error(estimate: &Vector2<f64>, truth: &Vector2<f64>) -> PositionError {
    PositionError { distance_m: truth.norm(), error_m: (estimate - truth).norm() }
}

/// Bin of a distance (m, not negative).
#[must_use]
pub fn distance_bin(distance_m: f64) -> usize {
    BIN_EDGES_M.iter().rposition(|edge| distance_m >= *edge).unwrap_or(0)
}

/// Name of a bin: `20–40 m`, `≥ 80 m`.
#[must_use]
pub fn bin_name(bin: usize) -> String {
    match (BIN_EDGES_M.get(bin), BIN_EDGES_M.get(bin + 1)) {
        (Some(low), Some(high)) => format!("{low:.0}–{high:.0} m"),
        (Some(low), None) => format!("≥ {low:.0} m"),
        (None, _) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_and_bins() {
        let error = position_error(&Vector2::new(3.3, 40.4), &Vector2::new(3.0, 40.0));
        assert!((error.error_m - 0.5).abs() < 1e-9);
        assert!((error.distance_m - 1609f64.sqrt()).abs() < 1e-9);
        assert_eq!([0.0, 19.99, 20.0, 79.0, 80.0, 500.0].map(distance_bin), [0, 0, 1, 3, 4, 4]);
        assert_eq!((bin_name(1), bin_name(4)), ("20–40 m".to_owned(), "≥ 80 m".to_owned()));
    }
}
