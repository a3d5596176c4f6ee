//! Errors of speed and heading, and how much parked cars seem to move.

use nalgebra::Vector2;
use roadplane_base::angle_difference;

/// Errors of one car's motion in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionError {
    /// |speed − true speed|, m/s.
    pub speed_mps: f64,
    /// Shortest turn between the headings, rad in 0–π.
    pub heading_rad: f64,
}

/// Errors of an estimated speed (m/s) and heading (rad).
#[must_use]
pub fn motion_error(
    speed_mps: f64,
    heading_rad: f64,
    true_speed_mps: f64,
    true_heading_rad: f64,
) -> MotionError {
    MotionError {
        speed_mps: (speed_mps - true_speed_mps).abs(),
        heading_rad: angle_difference(heading_rad, true_heading_rad).abs(),
    }
}

/// Root mean square displacement from frame to frame (m) of a track that stands still in truth; `places` are its ground
/// positions in consecutive frames. `None` of fewer than two.
#[must_use]
pub fn jitter_m(places: &[Vector2<f64>]) -> Option<f64> {
    let squares = places.windows(2).map(|pair| (pair[1] - pair[0]).norm_squared());
    (places.len() > 1).then(|| (squares.sum::<f64>() / (places.len() - 1) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_wrap() {
        let error = motion_error(-1.0, 3.1, 2.0, -3.1);
        assert!((error.speed_mps - 3.0).abs() < 1e-12);
        assert!((error.heading_rad - (std::f64::consts::TAU - 6.2)).abs() < 1e-12);
    }

    #[test]
    fn jitter_is_the_rms_step() {
        let places = [Vector2::new(0.0, 0.0), Vector2::new(0.3, 0.4), Vector2::new(0.3, 0.4)];
        assert!((jitter_m(&places).unwrap() - 0.125f64.sqrt()).abs() < 1e-12);
        assert_eq!(jitter_m(&places[..1]), None);
    }
}
