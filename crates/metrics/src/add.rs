//! ADD: the average distance between the points of a car model under the true and under the estimated pose.
//!
//! The metric is that of Hinterstoisser et al. 2012, "Model based training, detection and pose estimation of
//! texture-less 3D objects", Eq. 10. The tables give ADD in units of the object's diameter, as in Table 1 of Li et al.,
//! *Car Pose in Context*.

use nalgebra::{Isometry3, Point3};

/// Thresholds of ADD, in diameters of the object. The list begins with strict thresholds, at which today's methods
/// differ. It ends with those of Tables 1 and 3 of Li et al., *Car Pose in Context*.
pub const THRESHOLDS: [f64; 8] = [0.05, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.0];

/// Returns the mean distance (m) between a car's true points and the same points of an estimate, in the camera frame.
///
/// `true_points` and `estimated_points` are in the car frame (m), and correspond by index. A point that is missing on
/// either side is left out. Returns `None` if no point is present on both sides.
///
/// If `estimated_points` are the true points, the result is Hinterstoisser's ADD, which measures the pose alone. If
/// they are the points of the estimated shape, the result measures pose and shape, as in Li et al., *Car Pose in
/// Context*.
#[must_use]
pub fn add_m(
    true_points: &[Option<Point3<f64>>],
    true_camera_from_car: &Isometry3<f64>,
    estimated_points: &[Option<Point3<f64>>],
    estimated_camera_from_car: &Isometry3<f64>,
) -> Option<f64> {
    let distance = |pair: (&Option<Point3<f64>>, &Option<Point3<f64>>)| {
        let (truth, estimate) = ((*pair.0)?, (*pair.1)?);
        Some((true_camera_from_car * truth - estimated_camera_from_car * estimate).norm())
    };
    let distances: Vec<f64> = true_points.iter().zip(estimated_points).filter_map(distance).collect();
    (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64)
}

/// Returns the diameter of a car: the largest distance between two of its points, m. ADD is divided by this diameter.
/// The result is 0 for fewer than two points.
#[must_use]
pub fn diameter_m(points: &[Option<Point3<f64>>]) -> f64 {
    let present: Vec<&Point3<f64>> = points.iter().flatten().collect();
    let pairs =
        present.iter().enumerate().flat_map(|(i, a)| present[..i].iter().map(move |b| (*a - *b).norm()));
    pairs.fold(0.0, f64::max)
}

/// Returns the eight corners of a 3D box in the car frame. The box has the given length, width and height (m). The
/// centre of its bottom is the origin.
///
/// These corners replace a car's keypoints if the truth gives only the car's dimensions.
#[must_use]
pub fn box_corners([length, width, height]: [f64; 3]) -> [Option<Point3<f64>>; 8] {
    std::array::from_fn(|i| {
        let side = |bit: usize| if i & bit == 0 { -0.5 } else { 0.5 };
        let z = if i & 4 == 0 { 0.0 } else { height };
        Some(Point3::new(side(1) * length, side(2) * width, z))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    #[test]
    fn a_shift_is_its_length_and_a_half_turn_twice_the_mean_radius() {
        let points = [Some(Point3::new(1.0, 0.0, 0.0)), Some(Point3::new(-3.0, 0.0, 0.0)), None];
        let at = Isometry3::from_parts(Translation3::new(1.0, 2.0, 20.0), UnitQuaternion::identity());
        let shifted = Isometry3::from_parts(Translation3::new(1.0, 2.3, 20.4), UnitQuaternion::identity());
        assert!((add_m(&points, &at, &points, &shifted).unwrap() - 0.5).abs() < 1e-12);
        let turned = at * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        assert!((add_m(&points, &at, &points, &turned).unwrap() - 4.0).abs() < 1e-12);
        assert!((diameter_m(&points) - 4.0).abs() < 1e-12);
    }

    #[test]
    fn a_wrong_shape_counts_by_its_points() {
        let truth = [Some(Point3::new(1.0, 0.0, 0.0)), Some(Point3::new(2.0, 0.0, 0.0))];
        let estimate = [Some(Point3::new(1.0, 0.0, 0.4)), None];
        let at = Isometry3::identity();
        assert!((add_m(&truth, &at, &estimate, &at).unwrap() - 0.4).abs() < 1e-12);
        assert_eq!(add_m(&truth, &at, &[None, None], &at), None);
    }

    #[test]
    fn a_box_has_its_diagonal() {
        let corners = box_corners([4.0, 2.0, 1.5]);
        assert!((diameter_m(&corners) - (16.0f64 + 4.0 + 2.25).sqrt()).abs() < 1e-12);
    }
}
