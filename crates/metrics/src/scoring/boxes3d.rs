//! Scores poses against 3D boxes, for truth without keypoints (KITTI).

use nalgebra::{Isometry3, Point3, Translation3};
use roadplane_base::{Shape, ShapeAtlas};

use super::PoseScore;
use crate::add::{add_m, box_corners, diameter_m};
use crate::viewpoint::rotation_error_rad;

/// Returns the errors of an estimated pose and shape against a true box of length, width and height (m).
///
/// The box's frame has its origin at the centre of the box's bottom (x forward, y left, z up). ADD compares the eight
/// corners of the boxes. Its unit is the diagonal of the true box.
#[must_use]
pub fn score_box(
    true_dims_m: [f64; 3],
    true_camera_from_box: &Isometry3<f64>,
    camera_from_car: &Isometry3<f64>,
    shape: &Shape,
    atlas: &ShapeAtlas,
) -> PoseScore {
    let camera_from_box = camera_from_car * Translation3::new(body_centre_m(atlas, shape), 0.0, 0.0);
    let truth = box_corners(true_dims_m);
    let diameter = diameter_m(&truth);
    let add = |corners: &[Option<Point3<f64>>]| {
        let add_m = add_m(&truth, true_camera_from_box, corners, &camera_from_box);
        add_m.map_or(f64::INFINITY, |add_m| add_m / diameter)
    };
    PoseScore {
        add: add(&box_corners(atlas.dims_m(shape).into())),
        add_of_pose: add(&truth),
        rotation_rad: rotation_error_rad(&true_camera_from_box.rotation, &camera_from_box.rotation),
        ..PoseScore::missed(true_camera_from_box)
    }
}

/// Returns the distance from the point midway between the axles to the middle of the body, m (positive ahead). The two
/// points differ because the front and rear overhangs differ.
#[must_use]
pub fn body_centre_m(atlas: &ShapeAtlas, shape: &Shape) -> f64 {
    let points = atlas.keypoints_in_car(shape);
    let front = points.iter().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
    let rear = points.iter().map(|p| p.x).fold(f64::INFINITY, f64::min);
    (front + rear) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    #[test]
    fn the_mean_car_in_its_own_box_has_no_error_and_a_shift_is_its_length() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let shape = Shape::zeros();
        let camera_from_car = Isometry3::from_parts(
            Translation3::new(1.0, 1.6, 15.0),
            UnitQuaternion::from_euler_angles(1.6, 0.2, -0.4),
        );
        let centre = Translation3::new(body_centre_m(&atlas, &shape), 0.0, 0.0);
        let dims: [f64; 3] = atlas.dims_m(&shape).into();
        let exact = score_box(dims, &(camera_from_car * centre), &camera_from_car, &shape, &atlas);
        assert!(exact.add < 1e-9 && exact.add_of_pose < 1e-9 && exact.rotation_rad < 1e-6);
        let shifted = Translation3::from(Vector3::new(0.3, 0.0, 0.4)) * camera_from_car;
        let score = score_box(dims, &(camera_from_car * centre), &shifted, &shape, &atlas);
        let diagonal = dims.iter().map(|d| d * d).sum::<f64>().sqrt();
        assert!((score.add - 0.5 / diagonal).abs() < 1e-9);
        // A true box 0.4 m higher: its four upper corners are off by 0.4 m, and the pose is exact.
        let higher = [dims[0], dims[1], dims[2] + 0.4];
        let score = score_box(higher, &(camera_from_car * centre), &camera_from_car, &shape, &atlas);
        let diagonal = higher.iter().map(|d| d * d).sum::<f64>().sqrt();
        assert!((score.add - 0.2 / diagonal).abs() < 1e-9 && score.add_of_pose < 1e-9);
        assert!((body_centre_m(&atlas, &shape)).abs() < 0.4);
    }
}
