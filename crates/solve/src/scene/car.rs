//! Conversion of one car's estimate into a [`CarSolution`].

use nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix};
use roadplane_base::{CameraParams, MODES};

use crate::linear::arrow::Joint;
use crate::linear::gram::Gram;
use crate::model::on_plane::ON_PLANE;
use crate::model::pose::{CameraFrame, Pose as _};
use crate::problem::cars::GroundProblem;
use crate::solution::CarSolution;

/// Returns the solution of the car in view `k`, and the joint covariance of its (x, y, heading, shape).
///
/// `joint` is the covariance of (pose, shape, camera). Returns `None` if the pose cannot be evaluated.
pub(crate) fn car_solution(
    problem: &GroundProblem<'_, MODES>,
    k: usize,
    joint: &Joint,
) -> Option<(CarSolution, SMatrix<f64, 9, 9>)> {
    const CAMERA: usize = Gram::<ON_PLANE, MODES>::CAMERA;
    const UNKNOWNS: usize = Gram::<ON_PLANE, MODES>::RESIDUAL;
    let camera = CameraFrame::new(&problem.state.camera);
    let plane_pose = &problem.state.poses[k];
    let (ground, by) = plane_pose.on_ground(&plane_pose.frame(&camera)?, &camera);
    // Derivative of (x, y, heading) with respect to (anchor, heading, shape, camera).
    let mut change = SMatrix::<f64, ON_PLANE, UNKNOWNS>::zeros();
    change.fixed_columns_mut::<ON_PLANE>(0).copy_from(&by.fixed_columns::<ON_PLANE>(0));
    change.fixed_columns_mut::<4>(CAMERA).copy_from(&by.fixed_columns::<4>(ON_PLANE));
    let with_all = change * joint.fixed_view::<UNKNOWNS, UNKNOWNS>(0, 0);
    let ground_covariance: Matrix3<f64> = with_all * change.transpose();
    let with_shape = with_all.fixed_columns::<MODES>(ON_PLANE).into_owned();
    let shape_covariance: Matrix6<f64> = joint.fixed_view::<MODES, MODES>(ON_PLANE, ON_PLANE).into_owned();
    let mut covariance = SMatrix::<f64, 9, 9>::zeros();
    covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&ground_covariance);
    covariance.fixed_view_mut::<3, MODES>(0, 3).copy_from(&with_shape);
    covariance.fixed_view_mut::<MODES, 3>(3, 0).copy_from(&with_shape.transpose());
    covariance.fixed_view_mut::<MODES, MODES>(3, 3).copy_from(&shape_covariance);
    let fit = problem.fit_of(k)?;
    let params = CameraParams::from_vector(&problem.state.camera);
    let camera_from_car: Isometry3<f64> = params.plane().camera_from_world() * ground.world_from_car();
    let car = CarSolution {
        camera_from_car,
        ground,
        ground_covariance,
        shape: problem.state.shapes[problem.views[k].group],
        shape_covariance,
        inliers: fit.inliers,
        reprojection_rms_px: fit.rms_px,
        used: true,
    };
    Some((car, covariance))
}
