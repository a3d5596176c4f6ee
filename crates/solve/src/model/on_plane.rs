//! The pose of a car on the ground plane.
//!
//! The car's position T and rotation R in the camera frame follow from its anchor a and its heading ψ:
//!
//! ```text
//! T = ray · h / (−n · ray),   ray = (a_u / f, a_v / f, 1)          R = R(tilt, roll) Rz(ψ)
//! ```
//!
//! f is the focal length (px) and h the camera's height (m). n is the plane's normal, which points up. `R(tilt, roll)`
//! has the columns right, forward, up = n.
//!
//! The *anchor* is the pixel of the car's position, relative to the principal point. The unknown is the anchor, not a
//! position (x, y) in metres. So the car stays at the same pixel when focal length or plane change, and the problem is
//! much closer to linear.

use nalgebra::{Matrix3, SMatrix, Vector2, Vector3};
use roadplane_base::{GroundPose, wrap_angle};

use crate::model::pose::{CameraFrame, CarFrame, MIN_DEPTH_M, Pose, Twist};

/// Number of unknowns of a pose on the ground plane: anchor (2) and heading (1).
pub(crate) const ON_PLANE: usize = 3;

/// Smallest slope at which a viewing ray descends towards the plane, m per m of depth.
///
/// A ray with a smaller slope counts as horizontal.
const MIN_FALL: f64 = 1e-6;

/// The pose of a car on the ground plane.
///
/// `anchor` is the pixel of the car's origin, relative to the principal point, and `heading` is in rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlanePose {
    pub anchor: Vector2<f64>,
    pub heading: f64,
}

impl PlanePose {
    /// Converts a pose from the world frame; `None` if the car is behind the camera.
    pub fn of(pose: &GroundPose, camera: &CameraFrame) -> Option<Self> {
        let in_camera = camera.camera_from_world * Vector3::new(pose.x_m, pose.y_m, -camera.height_m);
        let anchor = || in_camera.xy() * (camera.focal_px / in_camera.z);
        (in_camera.z > MIN_DEPTH_M).then(|| Self { anchor: anchor(), heading: pose.heading_rad })
    }

    /// Returns the pose in the world frame, and its derivatives.
    ///
    /// The rows are x, y and heading. The columns are the anchor (2), the heading, and the camera (log f, tilt, roll,
    /// log h).
    pub fn on_ground(
        &self,
        frame: &CarFrame<ON_PLANE>,
        camera: &CameraFrame,
    ) -> (GroundPose, SMatrix<f64, 3, 7>) {
        let in_world = |v: Vector3<f64>| camera.camera_from_world.tr_mul(&v).xy();
        let mut by = SMatrix::<f64, 3, 7>::zeros();
        for (column, twist) in frame.by_pose[..2].iter().enumerate() {
            by.fixed_view_mut::<2, 1>(0, column).copy_from(&in_world(twist.shift));
        }
        by[(2, 2)] = 1.0;
        for (column, twist) in frame.by_camera.iter().enumerate() {
            // The axes of the world frame turn when tilt or roll change.
            let shift = twist.shift - twist.turn.cross(&frame.origin);
            by.fixed_view_mut::<2, 1>(0, ON_PLANE + column).copy_from(&in_world(shift));
        }
        let at = in_world(frame.origin);
        (GroundPose { x_m: at.x, y_m: at.y, heading_rad: wrap_angle(self.heading) }, by)
    }
}

impl Pose<ON_PLANE> for PlanePose {
    /// Returns the car in this camera's frame; `None` if the anchor is not below the horizon.
    fn frame(&self, camera: &CameraFrame) -> Option<CarFrame<ON_PLANE>> {
        let f = camera.focal_px;
        let up = camera.up();
        let ray = Vector3::new(self.anchor.x / f, self.anchor.y / f, 1.0);
        let fall = -up.dot(&ray);
        if fall.is_nan() || fall <= MIN_FALL {
            return None;
        }
        let depth = camera.height_m / fall;
        let origin = ray * depth;
        let by_ray = |d_ray: Vector3<f64>| (d_ray + ray * (up.dot(&d_ray) / fall)) * depth;
        let [_, by_tilt, by_roll, _] =
            camera.turns().map(|turn| Twist { shift: origin * (turn.cross(&up).dot(&ray) / fall), turn });
        let (sin, cos) = self.heading.sin_cos();
        let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        Some(CarFrame {
            focal_px: f,
            origin,
            camera_from_car: camera.camera_from_world * turn,
            by_pose: [
                Twist::shift(by_ray(Vector3::new(1.0 / f, 0.0, 0.0))),
                Twist::shift(by_ray(Vector3::new(0.0, 1.0 / f, 0.0))),
                Twist::turn(up),
            ],
            by_camera: [
                Twist::shift(by_ray(Vector3::new(-ray.x, -ray.y, 0.0))),
                by_tilt,
                by_roll,
                Twist::shift(origin),
            ],
        })
    }

    fn moved(&self, step: &[f64]) -> Self {
        Self { anchor: self.anchor + Vector2::new(step[0], step[1]), heading: self.heading + step[2] }
    }
}
