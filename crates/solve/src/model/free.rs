//! The free pose of a car (6 degrees of freedom), and soft cost terms that pull the car towards the ground plane.
//!
//! # Pose
//! The car's position T and rotation R in the camera frame depend on the six unknowns ω (3), u, v, ρ:
//!
//! ```text
//! T = e^ρ (u, v, f),    R ← exp([ω]×) R              (rotation vector ω in the camera frame)
//! ```
//!
//! (u, v) is the pixel of the car's origin relative to the principal point, and f is the focal length, px. The factor
//! e^ρ is the ratio of depth (m) to focal length. So if only f changes, only the depth of T changes. The reprojection
//! error then hardly changes (paper *Car Pose in Context*, §4.2, finding 2). With these unknowns, f alone describes
//! this weakly determined direction.
//!
//! # Plane terms
//! The plane has the unit normal n, which points up, and the camera is at the height h. The up axis of the car frame is
//! ẑ. The angle between the car's up direction R ẑ and n is θ:
//!
//! ```text
//! D_p2p = n · T + h                                  distance from the plane, m; paper, Eq. 4
//! D_v2v = R ẑ − n,   ‖D_v2v‖ = 2 sin(θ/2) ≈ θ        inclination, rad; in place of the paper's Eq. 5
//! ```
//!
//! The paper's Eq. 5 is arcsin ‖n × R ẑ‖. It gives the same value for a car on its roof and for a car on its wheels.

use nalgebra::{Rotation3, UnitQuaternion, Vector2, Vector3};

use crate::linear::gram::{Gram, MAX_WIDTH, Row};
use crate::model::pose::{CameraFrame, CarFrame, Pose, Twist};

/// Number of unknowns of a free pose.
pub(crate) const FREE: usize = 6;

/// A free pose of a car, with 6 degrees of freedom.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FreePose {
    pub camera_from_car: UnitQuaternion<f64>,
    /// Pixel of the car's origin, relative to the principal point.
    pub anchor: Vector2<f64>,
    /// Logarithm of the ratio of the origin's depth (m) to the focal length (px).
    pub log_depth_ratio: f64,
}

impl FreePose {
    /// Returns the car's origin in the camera frame, m.
    pub fn origin(&self, focal_px: f64) -> Vector3<f64> {
        Vector3::new(self.anchor.x, self.anchor.y, focal_px) * self.log_depth_ratio.exp()
    }
}

impl Pose<FREE> for FreePose {
    fn frame(&self, camera: &CameraFrame) -> Option<CarFrame<FREE>> {
        let origin = self.origin(camera.focal_px);
        let ratio = self.log_depth_ratio.exp();
        let shift = |x: f64, y: f64, z: f64| Twist::shift(Vector3::new(x, y, z));
        let none = Twist::shift(Vector3::zeros());
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(Twist::turn);
        Some(CarFrame {
            focal_px: camera.focal_px,
            origin,
            camera_from_car: self.camera_from_car.to_rotation_matrix().into_inner(),
            by_pose: [x, y, z, shift(ratio, 0.0, 0.0), shift(0.0, ratio, 0.0), Twist::shift(origin)],
            by_camera: [shift(0.0, 0.0, origin.z), none, none, none],
        })
    }

    fn moved(&self, step: &[f64]) -> Self {
        let turn = Rotation3::new(Vector3::new(step[0], step[1], step[2]));
        let mut camera_from_car = UnitQuaternion::from_rotation_matrix(&turn) * self.camera_from_car;
        camera_from_car.renormalize_fast();
        Self {
            camera_from_car,
            anchor: self.anchor + Vector2::new(step[3], step[4]),
            log_depth_ratio: self.log_depth_ratio + step[5],
        }
    }
}

/// Soft cost terms that pull cars with free poses towards the ground plane.
///
/// In the paper *Car Pose in Context* (Eq. 6, 7), the inverse squares of these sds are the weights μ₁ and μ₂.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneTerms {
    /// Standard deviation of a car's distance from the plane, m.
    pub distance_sd_m: f64,
    /// Standard deviation of the angle between a car's up direction and the plane's normal, rad.
    pub angle_sd: f64,
}

impl PlaneTerms {
    /// Returns the residuals of the plane terms with their derivatives, as rows in the same format as keypoint rows.
    ///
    /// The first row is the car's distance from the plane. The other three rows are the components of the car's up
    /// direction minus the plane's normal. All residuals are divided by their sds.
    pub(crate) fn rows<const N: usize, const M: usize>(
        &self,
        camera: &CameraFrame,
        frame: &CarFrame<N>,
    ) -> [Row; 4] {
        let (up, car_up) = (camera.up(), frame.camera_from_car.column(2).into_owned());
        let mut rows = [[0.0; MAX_WIDTH]; 4];
        let mut put = |column: usize, distance: f64, angles: Vector3<f64>| {
            rows[0][column] = distance / self.distance_sd_m;
            for (row, angle) in rows[1..].iter_mut().zip(angles.iter()) {
                row[column] = angle / self.angle_sd;
            }
        };
        for (column, twist) in frame.by_pose.iter().enumerate() {
            put(column, up.dot(&twist.shift), twist.turn.cross(&car_up));
        }
        let heights = [0.0, 0.0, 0.0, camera.height_m];
        for (i, ((twist, turn), height)) in
            frame.by_camera.iter().zip(camera.turns()).zip(heights).enumerate()
        {
            let up_moves = turn.cross(&up);
            let distance = up.dot(&twist.shift) + up_moves.dot(&frame.origin) + height;
            put(Gram::<N, M>::CAMERA + i, distance, twist.turn.cross(&car_up) - up_moves);
        }
        put(Gram::<N, M>::RESIDUAL, up.dot(&frame.origin) + camera.height_m, car_up - up);
        rows
    }
}
