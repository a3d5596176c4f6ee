//! The rigid motion of a car in the camera frame, and its derivatives by all unknowns.
//!
//! ```text
//! X_cam = T + R X(λ)          pixel − pp = f (X_cam.x, X_cam.y) / X_cam.z
//! ```
//!
//! A pose is on the plane (`on_plane.rs`) or free (`free.rs`). In both cases, a change of an unknown of pose or camera
//! moves the car as a rigid body: T by `shift`, R by `[turn]× R`. Source: paper Eq. 1.

use nalgebra::{Matrix3, Vector2, Vector3, Vector4};

/// Least depth at which a keypoint is evaluated, m.
pub(crate) const MIN_DEPTH_M: f64 = 0.1;

/// Camera and plane in the form that all cars share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraFrame {
    pub focal_px: f64,
    pub height_m: f64,
    /// Columns right, forward, up.
    pub camera_from_world: Matrix3<f64>,
}

impl CameraFrame {
    /// Creates the frame from (log f, tilt, roll, log h).
    pub fn new(params: &Vector4<f64>) -> Self {
        let (sin_t, cos_t) = params[1].sin_cos();
        let (sin_r, cos_r) = params[2].sin_cos();
        let right = Vector3::new(cos_r, sin_r, 0.0);
        let forward = Vector3::new(sin_r * sin_t, -cos_r * sin_t, cos_t);
        let up = Vector3::new(sin_r * cos_t, -cos_r * cos_t, -sin_t);
        Self {
            focal_px: params[0].exp(),
            height_m: params[3].exp(),
            camera_from_world: Matrix3::from_columns(&[right, forward, up]),
        }
    }

    pub fn up(&self) -> Vector3<f64> {
        self.camera_from_world.column(2).into_owned()
    }

    /// Returns the axes about which log f, tilt, roll and log h turn the world.
    pub fn turns(&self) -> [Vector3<f64>; 4] {
        let none = Vector3::zeros();
        [none, self.camera_from_world.column(0).into_owned(), Vector3::z(), none]
    }
}

/// Derivative of a car's motion by an unknown, camera frame: a point at X from its origin moves by `shift + turn × X`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Twist {
    pub shift: Vector3<f64>,
    pub turn: Vector3<f64>,
}

impl Twist {
    pub fn shift(shift: Vector3<f64>) -> Self {
        Self { shift, turn: Vector3::zeros() }
    }

    pub fn turn(turn: Vector3<f64>) -> Self {
        Self { shift: Vector3::zeros(), turn }
    }
}

/// A car in the camera frame, with the part of the Jacobian that its keypoints share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CarFrame<const N: usize> {
    pub focal_px: f64,
    /// T: the car's origin, m.
    pub origin: Vector3<f64>,
    /// R: rotation from the car's to the camera's frame.
    pub camera_from_car: Matrix3<f64>,
    pub by_pose: [Twist; N],
    /// Derivatives by log f, tilt, roll and log h. The direct effect of f on pixels is not in it.
    pub by_camera: [Twist; 4],
}

impl<const N: usize> CarFrame<N> {
    /// Returns the pixel of a point of the car, relative to the principal point; `None` at or behind the camera.
    #[inline]
    pub fn project(&self, point_in_car: &Vector3<f64>) -> Option<Vector2<f64>> {
        let p = self.origin + self.camera_from_car * point_in_car;
        (p.z > MIN_DEPTH_M).then(|| p.xy() * (self.focal_px / p.z))
    }
}

/// A pose of N unknowns.
pub(crate) trait Pose<const N: usize>: Copy {
    /// Returns the car in this camera's frame; `None` if the pose cannot be evaluated there.
    fn frame(&self, camera: &CameraFrame) -> Option<CarFrame<N>>;

    /// Returns the pose after a step: its first N entries are those of the pose's unknowns.
    fn moved(&self, step: &[f64]) -> Self;
}
