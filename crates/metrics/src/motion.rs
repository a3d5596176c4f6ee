//! Errors of speed and heading, and the jitter of parked cars.

use nalgebra::Vector2;
use roadplane_base::angle_difference;

/// Errors of one car's speed and heading in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionError {
    /// Absolute error of the speed, m/s.
    pub speed_mps: f64,
    /// Angle between the estimated and the true heading, rad in 0–π.
    pub heading_rad: f64,
}

/// Returns the errors of an estimated speed (m/s) and heading (rad) against the true ones.
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

/// Returns the jitter of a parked car's track: the root mean square displacement between consecutive frames, m.
///
/// `positions_m` are the track's positions on the ground in consecutive frames. Returns `None` for fewer than two
/// positions.
#[must_use]
pub fn jitter_m(positions_m: &[Vector2<f64>]) -> Option<f64> {
    let squares = positions_m.windows(2).map(|pair| (pair[1] - pair[0]).norm_squared());
    (positions_m.len() > 1).then(|| (squares.sum::<f64>() / (positions_m.len() - 1) as f64).sqrt())
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
        let positions = [Vector2::new(0.0, 0.0), Vector2::new(0.3, 0.4), Vector2::new(0.3, 0.4)];
        assert!((jitter_m(&positions).unwrap() - 0.125f64.sqrt()).abs() < 1e-12);
        assert_eq!(jitter_m(&positions[..1]), None);
    }
}
