//! Where a car is before the camera, and how every unknown moves it.
//!
//! ```text
//! X_cam = T + R X(λ)          pixel − pp = f (X_cam.x, X_cam.y) / X_cam.z
//! ```
//!
//! Whatever holds the pose of a car (it stands on the plane, `standing.rs`, or is anywhere, `free.rs`), an unknown of pose or
//! camera that grows moves the car as a rigid body: T by `shift`, R by `[turn]× R`. Source: paper Eq. 1.

use nalgebra::{Matrix3, Vector2, Vector3, Vector4};

/// Nearest depth at which a keypoint is evaluated, m.
pub(crate) const MIN_DEPTH_M: f64 = 0.1;

/// What all cars share of the camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraFrame {
    pub focal_px: f64,
    pub height_m: f64,
    /// Columns right, forward, up.
    pub camera_from_world: Matrix3<f64>,
}

impl CameraFrame {
    /// From (log f, tilt, roll, log h).
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

    /// About which axes log f, tilt, roll, log h turn the world.
    pub fn turns(&self) -> [Vector3<f64>; 4] {
        let none = Vector3::zeros();
        [none, self.camera_from_world.column(0).into_owned(), Vector3::z(), none]
    }
}

/// Velocity of a car by an unknown, camera frame: a point at X from its origin moves by `shift + turn × X`.
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

/// A car before the camera with what its keypoints share of the Jacobian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CarFrame<const N: usize> {
    pub focal_px: f64,
    /// T, m.
    pub origin: Vector3<f64>,
    /// R.
    pub camera_from_car: Matrix3<f64>,
    pub by_pose: [Twist; N],
    /// By log f (where f itself scales pixels, too), tilt, roll, log h.
    pub by_camera: [Twist; 4],
}

impl<const N: usize> CarFrame<N> {
    /// Pixel (relative to the principal point) of a point of the car; `None` at or behind the camera.
    #[inline]
    pub fn project(&self, point_in_car: &Vector3<f64>) -> Option<Vector2<f64>> {
        let p = self.origin + self.camera_from_car * point_in_car;
        (p.z > MIN_DEPTH_M).then(|| p.xy() * (self.focal_px / p.z))
    }
}

/// A pose of N unknowns.
pub(crate) trait Pose<const N: usize>: Copy {
    /// Before this camera; `None` where that is no place.
    fn frame(&self, camera: &CameraFrame) -> Option<CarFrame<N>>;

    /// Changed by a step in its unknowns, of which more may follow.
    fn moved(&self, step: &[f64]) -> Self;
}
