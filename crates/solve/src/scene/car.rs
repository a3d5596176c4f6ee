//! A car as the caller gets it.

use nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix};
use roadplane_base::{CameraParams, KEYPOINTS, MODES};

use crate::linear::arrow::Joint;
use crate::linear::gram::{SHAPE, camera as camera_column, residual};
use crate::model::ground::{CameraFrame, StandingFrame};
use crate::problem::ground::GroundProblem;
use crate::solution::CarSolution;

/// A view's solution, and the joint covariance of (x, y, heading, shape).
pub(crate) fn car_solution(
    problem: &GroundProblem<'_>,
    k: usize,
    joint: &Joint,
) -> Option<(CarSolution, SMatrix<f64, 9, 9>)> {
    let camera = CameraFrame::new(&problem.state.camera);
    let standing = &problem.state.standings[k];
    let frame = StandingFrame::new(&camera, standing)?;
    let (ground, by) = frame.ground_pose(&camera, standing.heading);
    // (x, y, heading) by (anchor, heading, shape, camera)
    const UNKNOWNS: usize = residual(MODES);
    let mut change = SMatrix::<f64, SHAPE, UNKNOWNS>::zeros();
    change.fixed_columns_mut::<SHAPE>(0).copy_from(&by.fixed_columns::<3>(4));
    change.fixed_columns_mut::<4>(camera_column(MODES)).copy_from(&by.fixed_columns::<4>(0));
    let with_all = change * joint.fixed_view::<UNKNOWNS, UNKNOWNS>(0, 0);
    let ground_covariance: Matrix3<f64> = with_all * change.transpose();
    let with_shape = with_all.fixed_columns::<MODES>(SHAPE).into_owned();
    let shape_covariance: Matrix6<f64> = joint.fixed_view::<MODES, MODES>(SHAPE, SHAPE).into_owned();
    let mut covariance = SMatrix::<f64, 9, 9>::zeros();
    covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&ground_covariance);
    covariance.fixed_view_mut::<3, MODES>(0, 3).copy_from(&with_shape);
    covariance.fixed_view_mut::<MODES, 3>(3, 0).copy_from(&with_shape.transpose());
    covariance.fixed_view_mut::<MODES, MODES>(3, 3).copy_from(&shape_covariance);
    let mut inliers = [false; KEYPOINTS];
    let (mut sum, mut count) = (0.0, 0.0);
    problem.each_residual(k, |observation, off_px, squared| {
        inliers[observation.index] = problem.kernel.weight(squared) > 0.5;
        if inliers[observation.index] {
            sum += off_px.norm_squared();
            count += 1.0;
        }
    })?;
    let params = CameraParams::from_vector(&problem.state.camera);
    let camera_from_car: Isometry3<f64> = params.plane().camera_from_world() * ground.world_from_car();
    let car = CarSolution {
        camera_from_car,
        ground,
        ground_covariance,
        shape: problem.state.shapes[problem.views[k].group],
        shape_covariance,
        inliers,
        reprojection_rms_px: if count > 0.0 { f64::sqrt(sum / count) } else { f64::INFINITY },
        used: true,
    };
    Some((car, covariance))
}
