//! Position error on the ground by distance from the camera.

use nalgebra::Vector2;
use roadplane_base::Similarity;

/// What "at 40 m" means, m: from, up to.
pub const AT_40_M: [f64; 2] = [30.0, 50.0];
/// Everywhere.
pub const ALL_M: [f64; 2] = [0.0, f64::INFINITY];
/// Distances that are looked at; [`AT_40_M`] overlaps its neighbours.
pub const RANGES_M: [[f64; 2]; 7] =
    [[0.0, 20.0], [20.0, 40.0], AT_40_M, [40.0, 60.0], [60.0, 80.0], [80.0, f64::INFINITY], ALL_M];

/// Error of an estimated position and where it happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionError {
    /// True distance from the camera's foot on the ground, m.
    pub distance_m: f64,
    /// Length of the error on the ground, m; infinite without an estimate.
    pub error_m: f64,
    /// What is left of it when the scene's cars have been laid over the true ones, m.
    pub aligned_m: f64,
}

/// A scene of fewer cars is not aligned: that would hide errors of the cars.
const FEWEST_ALIGNED: usize = 5;

/// Errors of a scene's estimated positions against the true ones, each in its own world (x right, y ahead of the camera,
/// origin at its foot), so that errors of the estimated camera count; m.
///
/// Aligned: after the turn, shift and scale of the ground that lay the scene's cars over the true ones with the least squares
/// (Umeyama 1991, IEEE PAMI 13), as trajectories of one camera are compared (Sturm et al. 2012, IROS): without what knowing a
/// few places or lengths on the ground would take away. `cars`: how many the places are of.
#[must_use]
pub fn position_errors(places: &[(Option<Vector2<f64>>, Vector2<f64>)], cars: usize) -> Vec<PositionError> {
    let found: Vec<_> = places.iter().filter_map(|(estimate, truth)| Some(((*estimate)?, *truth))).collect();
    let fit = if cars.min(found.len()) < FEWEST_ALIGNED { None } else { Similarity::fit(&found) };
    let of = |(estimate, truth): &(Option<Vector2<f64>>, Vector2<f64>)| {
        let error_m = estimate.map_or(f64::INFINITY, |estimate| (estimate - truth).norm());
        let aligned = estimate.and_then(|estimate| Some((fit?.apply(&estimate) - truth).norm()));
        PositionError { distance_m: truth.norm(), error_m, aligned_m: aligned.unwrap_or(error_m) }
    };
    places.iter().map(of).collect()
}

/// Whether a distance (m) lies in a range.
#[must_use]
pub fn in_range([from_m, to_m]: [f64; 2], distance_m: f64) -> bool {
    (from_m..to_m).contains(&distance_m)
}

/// Name of a range: `20–40 m`, `≥ 80 m`, `all`.
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
        let places =
            [(Some(Vector2::new(3.3, 40.4)), Vector2::new(3.0, 40.0)), (None, Vector2::new(0.0, 30.0))];
        let errors = position_errors(&places, 2);
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
    fn a_larger_world_is_laid_over_the_true_one() {
        let truth = [[0.0, 20.0], [5.0, 20.0], [0.0, 30.0], [5.0, 30.0], [-4.0, 50.0], [9.0, 45.0]]
            .map(Vector2::from);
        let mut places = truth.map(|truth| (Some(truth * 1.03 + Vector2::new(0.2, 0.0)), truth));
        let errors = position_errors(&places, places.len());
        assert!(errors.iter().all(|e| e.error_m > 0.5 && e.aligned_m < 1e-9));
        // One car elsewhere cannot hide.
        places[5].0 = Some(truth[5] + Vector2::new(3.0, 0.0));
        assert!(position_errors(&places, places.len())[5].aligned_m > 1.0);
        // Two cars, three times each.
        assert!(position_errors(&places, 2)[0].aligned_m > 0.5);
    }
}
