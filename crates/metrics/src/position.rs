//! Errors of positions on the ground, grouped by the distance from the camera.

use nalgebra::Vector2;
use roadplane_base::Similarity;

/// Range of distances that the tables call "at 40 m": lower and upper limit, m.
pub const AT_40_M: [f64; 2] = [30.0, 50.0];
/// Range that includes all distances: lower and upper limit, m.
pub const ALL_M: [f64; 2] = [0.0, f64::INFINITY];
/// Ranges of distance in the tables: lower and upper limit, m. [`AT_40_M`] overlaps its neighbours.
pub const RANGES_M: [[f64; 2]; 7] =
    [[0.0, 20.0], [20.0, 40.0], AT_40_M, [40.0, 60.0], [60.0, 80.0], [80.0, f64::INFINITY], ALL_M];

/// Error of one estimated position, with the true distance from the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionError {
    /// True distance from the camera's foot point on the ground, m.
    pub distance_m: f64,
    /// Distance between the estimated and the true position on the ground, m. It is infinite without an estimate.
    pub error_m: f64,
    /// Distance between the estimated and the true position after alignment, m. The alignment moves all estimated
    /// positions of the scene together.
    pub aligned_m: f64,
}

/// Least number of cars in a scene that is aligned. With fewer cars, the alignment would hide the errors of the cars.
const FEWEST_ALIGNED: usize = 5;

/// Returns the errors of a scene's estimated positions against the true ones, m.
///
/// `positions_m` are pairs of an estimated and a true position. Each position is in its own world frame: the origin is
/// the camera's foot point, x points right and y ahead. So the errors include errors of the estimated camera. `cars` is
/// the number of different cars.
///
/// The alignment is the rotation, shift and scale on the ground with the least squared errors (Umeyama 1991, IEEE PAMI
/// 13). Sturm et al. 2012 (IROS) align the trajectories of a single camera in this manner. Aligned errors exclude the
/// part that a few surveyed points or lengths would remove.
#[must_use]
pub fn position_errors(
    positions_m: &[(Option<Vector2<f64>>, Vector2<f64>)],
    cars: usize,
) -> Vec<PositionError> {
    let found: Vec<_> =
        positions_m.iter().filter_map(|(estimate, truth)| Some(((*estimate)?, *truth))).collect();
    let fit = if cars.min(found.len()) < FEWEST_ALIGNED { None } else { Similarity::fit(&found) };
    let of = |(estimate, truth): &(Option<Vector2<f64>>, Vector2<f64>)| {
        let error_m = estimate.map_or(f64::INFINITY, |estimate| (estimate - truth).norm());
        let aligned = estimate.and_then(|estimate| Some((fit?.apply(&estimate) - truth).norm()));
        PositionError { distance_m: truth.norm(), error_m, aligned_m: aligned.unwrap_or(error_m) }
    };
    positions_m.iter().map(of).collect()
}

/// Returns whether a distance (m) is in a range. The lower limit belongs to the range, and the upper limit does not.
#[must_use]
pub fn in_range([from_m, to_m]: [f64; 2], distance_m: f64) -> bool {
    (from_m..to_m).contains(&distance_m)
}

/// Returns the name of a range of distances, such as `20–40 m`, `≥ 80 m` or `all`.
#[must_use]
pub fn range_name([from_m, to_m]: [f64; 2]) -> String {
    match (from_m, to_m) {
        (0.0, f64::INFINITY) => "all".to_owned(),
        (_, f64::INFINITY) => format!("≥ {from_m:.0} m"),
        _ => format!("{from_m:.0}–{to_m:.0} m"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_and_ranges() {
        let positions =
            [(Some(Vector2::new(3.3, 40.4)), Vector2::new(3.0, 40.0)), (None, Vector2::new(0.0, 30.0))];
        let errors = position_errors(&positions, 2);
        assert!((errors[0].error_m - 0.5).abs() < 1e-9 && (errors[0].aligned_m - 0.5).abs() < 1e-9);
        assert!((errors[0].distance_m - 1609f64.sqrt()).abs() < 1e-9);
        assert!(errors[1].error_m.is_infinite() && errors[1].aligned_m.is_infinite());
        let ranges_of = |distance_m| RANGES_M.iter().filter(|range| in_range(**range, distance_m)).count();
        assert_eq!(
            [0.0, 19.99, 20.0, 30.0, 49.9, 50.0, 80.0, 500.0].map(ranges_of),
            [2, 2, 2, 3, 3, 2, 2, 2]
        );
        assert!(in_range(RANGES_M[1], 20.0) && !in_range(RANGES_M[0], 20.0));
        let names = [RANGES_M[1], RANGES_M[5], RANGES_M[6]].map(range_name);
        assert_eq!(names, ["20–40 m", "≥ 80 m", "all"]);
    }

    #[test]
    fn a_larger_world_is_aligned_with_the_true_one() {
        let truth = [[0.0, 20.0], [5.0, 20.0], [0.0, 30.0], [5.0, 30.0], [-4.0, 50.0], [9.0, 45.0]]
            .map(Vector2::from);
        let mut positions = truth.map(|truth| (Some(truth * 1.03 + Vector2::new(0.2, 0.0)), truth));
        let errors = position_errors(&positions, positions.len());
        assert!(errors.iter().all(|e| e.error_m > 0.5 && e.aligned_m < 1e-9));
        // The alignment does not hide the error of one car.
        positions[5].0 = Some(truth[5] + Vector2::new(3.0, 0.0));
        assert!(position_errors(&positions, positions.len())[5].aligned_m > 1.0);
        // If the six positions belong to two cars only, they are not aligned.
        assert!(position_errors(&positions, 2)[0].aligned_m > 0.5);
    }
}
