//! Position and rotation of a car in the camera frame, and their derivatives with respect to all unknowns.
//!
//! ```text
//! X_cam = T + R X(λ)          pixel − pp = f (X_cam.x, X_cam.y) / X_cam.z
//! ```
//!
//! X(λ) is a keypoint of a car of shape λ, in the car frame. T and R are the car's position and rotation in the camera
//! frame, f is the focal length and pp the principal point. Source: the paper *Car Pose in Context*, Eq. 1.
//!
//! A pose is on the ground plane (`on_plane.rs`) or has 6 degrees of freedom (`free.rs`). In both cases, the car moves
//! as a rigid body when an unknown of pose or camera changes. T changes by `shift`, and R by `[turn]× R`.

use nalgebra::{Matrix3, Vector2, Vector3, Vector4};

/// Smallest depth at which a keypoint can be projected, m.
pub(crate) const MIN_DEPTH_M: f64 = 0.1;

/// Camera and ground plane, with quantities that are computed once for all cars.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraFrame {
    pub focal_px: f64,
    pub height_m: f64,
    /// Rotation from the world frame to the camera frame. Its columns are the world's right, forward and up axes.
    pub camera_from_world: Matrix3<f64>,
}

impl CameraFrame {
    /// Creates the frame from the camera's parameters (log f, tilt, roll, log h).
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

    /// Returns the axes, in the camera frame, about which the world turns when log f, tilt, roll or log h changes.
    ///
    /// The axis is zero for log f and log h, which do not turn the world.
    pub fn turns(&self) -> [Vector3<f64>; 4] {
        let none = Vector3::zeros();
        [none, self.camera_from_world.column(0).into_owned(), Vector3::z(), none]
    }
}

/// Derivative of a car's position and rotation with respect to one unknown, in the camera frame.
///
/// A point of the car at the offset X from the car's origin moves by `shift + turn × X` per unit of the unknown.
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

/// Position and rotation of a car in the camera frame, with the derivatives that all its keypoints share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CarFrame<const N: usize> {
    pub focal_px: f64,
    /// Position T of the car's origin in the camera frame, m.
    pub origin: Vector3<f64>,
    /// Rotation R from the car frame to the camera frame.
    pub camera_from_car: Matrix3<f64>,
    pub by_pose: [Twist; N],
    /// Derivatives with respect to log f, tilt, roll and log h.
    ///
    /// The first of them does not include the direct effect of the focal length f on pixels.
    pub by_camera: [Twist; 4],
}

impl<const N: usize> CarFrame<N> {
    /// Returns the pixel of a point of the car, relative to the principal point.
    ///
    /// Returns `None` if the point is at or behind the camera.
    #[inline]
    pub fn project(&self, point_in_car: &Vector3<f64>) -> Option<Vector2<f64>> {
        let p = self.origin + self.camera_from_car * point_in_car;
        (p.z > MIN_DEPTH_M).then(|| p.xy() * (self.focal_px / p.z))
    }
}

/// A pose of a car with N unknowns.
pub(crate) trait Pose<const N: usize>: Copy {
    /// Returns the car in this camera's frame; `None` if the pose cannot be evaluated there.
    fn frame(&self, camera: &CameraFrame) -> Option<CarFrame<N>>;

    /// Returns the pose after a step, whose first N entries are the changes of the pose's unknowns.
    fn moved(&self, step: &[f64]) -> Self;
}
