//! Projection of a keypoint of a car that stands on the plane.
//!
//! ```text
//! X_cam = G(c, a) + R(tilt, roll) Rz(ψ) X(λ)          pixel − pp = f (X_cam.x, X_cam.y) / X_cam.z
//! G = ray · h / (−n · ray),   ray = (a_u / f, a_v / f, 1)     the car's origin on the ground
//! ```
//!
//! The position is held by its pixel `a` relative to the principal point (the *anchor*, px), not by (x, y) in metres: when
//! focal length or plane change, the car stays where it is seen, so the problem is far closer to linear. `R = camera_from_world`
//! rotation with columns right, forward, up = n. Its derivatives by camera, shape and pose are worked out four keypoints at a time
//! (`rows.rs`). Source: paper Eq. 1.

use nalgebra::{Matrix3, SVector, Vector2, Vector3, Vector4};
use roadplane_base::{ALL_MODES, GroundPose, KEYPOINTS, MODES, ShapeAtlas};

/// Nearest depth at which a keypoint is evaluated, m.
pub(crate) const MIN_DEPTH_M: f64 = 0.1;

/// Smallest sine-like fall of a viewing ray towards the plane: below, the anchor is at the horizon.
const MIN_FALL: f64 = 1e-6;

/// Factor on the sd of what all modes leave unexplained of a keypoint: a car is off by the same on both sides and in all its
/// views, while keypoints are taken for independent. Measured on cars of makes that the atlas had been built without.
pub(crate) const SHARED: f64 = std::f64::consts::SQRT_2;

/// What all cars share of the camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraFrame {
    pub focal_px: f64,
    pub height_m: f64,
    /// Columns right, forward, up.
    pub camera_from_world: Matrix3<f64>,
    /// Its derivative by tilt.
    by_tilt: Matrix3<f64>,
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
            by_tilt: Matrix3::from_columns(&[Vector3::zeros(), up, -forward]),
        }
    }

    fn up(&self) -> Vector3<f64> {
        self.camera_from_world.column(2).into_owned()
    }

    /// The anchor of a position on the ground; `None` behind the camera.
    pub fn anchor_of(&self, pose: &GroundPose) -> Option<Vector2<f64>> {
        let in_camera = self.camera_from_world * Vector3::new(pose.x_m, pose.y_m, -self.height_m);
        (in_camera.z > MIN_DEPTH_M).then(|| in_camera.xy() * (self.focal_px / in_camera.z))
    }
}

/// Where a car stands: anchor (px from the principal point) and heading (rad).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Standing {
    pub anchor: Vector2<f64>,
    pub heading: f64,
}

/// A car's place in the camera frame with what its keypoints share of the Jacobian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StandingFrame {
    pub focal_px: f64,
    /// Car's origin in the camera frame, m.
    pub origin: Vector3<f64>,
    /// `camera_from_car` rotation.
    pub camera_from_car: Matrix3<f64>,
    /// Its derivative by tilt.
    pub camera_from_car_by_tilt: Matrix3<f64>,
    /// ∂G by log f, tilt, roll, log h, a_u, a_v.
    pub origin_by: [Vector3<f64>; 6],
}

impl StandingFrame {
    /// `None` when the anchor is not below the horizon.
    pub fn new(camera: &CameraFrame, standing: &Standing) -> Option<Self> {
        let f = camera.focal_px;
        let up = camera.up();
        let ray = Vector3::new(standing.anchor.x / f, standing.anchor.y / f, 1.0);
        let fall = -up.dot(&ray);
        if fall.is_nan() || fall <= MIN_FALL {
            return None;
        }
        let depth = camera.height_m / fall;
        let origin = ray * depth;
        let by_ray = |d_ray: Vector3<f64>| (d_ray + ray * (up.dot(&d_ray) / fall)) * depth;
        let by_normal = |d_up: Vector3<f64>| origin * (d_up.dot(&ray) / fall);
        let forward = camera.camera_from_world.column(1).into_owned();
        let origin_by = [
            by_ray(Vector3::new(-ray.x, -ray.y, 0.0)),
            by_normal(-forward),
            by_normal(Vector3::new(-up.y, up.x, 0.0)),
            origin,
            by_ray(Vector3::new(1.0 / f, 0.0, 0.0)),
            by_ray(Vector3::new(0.0, 1.0 / f, 0.0)),
        ];
        let (sin, cos) = standing.heading.sin_cos();
        let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        Some(Self {
            focal_px: f,
            origin,
            camera_from_car: camera.camera_from_world * turn,
            camera_from_car_by_tilt: camera.by_tilt * turn,
            origin_by,
        })
    }

    /// Pixel (relative to the principal point) of a point of the car; `None` at or behind the camera.
    #[inline]
    pub fn project(&self, point_in_car: &Vector3<f64>) -> Option<Vector2<f64>> {
        let p = self.origin + self.camera_from_car * point_in_car;
        (p.z > MIN_DEPTH_M).then(|| p.xy() * (self.focal_px / p.z))
    }

    /// Pose in the world frame with ∂(x, y, ψ) by (log f, tilt, roll, log h, a_u, a_v, ψ).
    pub fn ground_pose(
        &self,
        camera: &CameraFrame,
        heading: f64,
    ) -> (GroundPose, nalgebra::SMatrix<f64, 3, 7>) {
        let right = camera.camera_from_world.column(0);
        let forward = camera.camera_from_world.column(1);
        let up = camera.up();
        let mut jacobian = nalgebra::SMatrix::<f64, 3, 7>::zeros();
        for (column, d) in [0, 1, 2, 3, 4, 5].into_iter().zip(&self.origin_by) {
            jacobian[(0, column)] = right.dot(d);
            jacobian[(1, column)] = forward.dot(d);
        }
        // The axes turn too: ∂forward/∂tilt = up; roll turns right and forward about the optical axis.
        let by_roll = |axis: Vector3<f64>| Vector3::new(-axis.y, axis.x, 0.0);
        jacobian[(1, 1)] += up.dot(&self.origin);
        jacobian[(0, 2)] += by_roll(right.into_owned()).dot(&self.origin);
        jacobian[(1, 2)] += by_roll(forward.into_owned()).dot(&self.origin);
        jacobian[(2, 6)] = 1.0;
        let pose = GroundPose {
            x_m: right.dot(&self.origin),
            y_m: forward.dot(&self.origin),
            heading_rad: roadplane_base::wrap_angle(heading),
        };
        (pose, jacobian)
    }
}

/// The atlas with the modes of one keypoint side by side, as the inner loop reads them.
#[derive(Clone, Debug)]
pub(crate) struct PointModes<const M: usize = MODES> {
    pub mean: [Vector3<f64>; KEYPOINTS],
    pub modes: [[Vector3<f64>; M]; KEYPOINTS],
    /// Bounds of the coefficients.
    pub bounds: [[f64; 2]; M],
    /// sd of what these modes leave unexplained, m along the car's axes.
    pub residual_sd_m: [Vector3<f64>; KEYPOINTS],
}

impl PointModes<MODES> {
    /// The first modes, within the atlas' bounds.
    pub fn new(atlas: &ShapeAtlas) -> Self {
        Self {
            mean: atlas.mean,
            modes: std::array::from_fn(|i| std::array::from_fn(|j| atlas.modes[j][i])),
            bounds: atlas.bounds,
            residual_sd_m: atlas.residual_sd_m,
        }
    }
}

impl PointModes<ALL_MODES> {
    /// All modes, the fine ones too; their prior holds them instead of bounds.
    pub fn of_all_modes(atlas: &ShapeAtlas) -> Self {
        let mode = |j: usize| if j < MODES { &atlas.modes[j] } else { &atlas.fine_modes[j - MODES] };
        Self {
            mean: atlas.mean,
            modes: std::array::from_fn(|i| std::array::from_fn(|j| mode(j)[i])),
            bounds: [[f64::NEG_INFINITY, f64::INFINITY]; ALL_MODES],
            residual_sd_m: atlas.fine_residual_sd_m.map(|sd| sd * SHARED),
        }
    }
}

impl<const M: usize> PointModes<M> {
    /// A keypoint of a car of this shape, car frame, m.
    #[inline]
    pub fn point(&self, index: usize, shape: &SVector<f64, M>) -> Vector3<f64> {
        let mut point = self.mean[index];
        for (mode, coefficient) in self.modes[index].iter().zip(shape.iter()) {
            point += mode * *coefficient;
        }
        point
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{CameraParams, Shape, wrap_angle};
    use roadplane_synth::Rng;

    /// (camera, shape, anchor, heading) → pixel of a keypoint.
    fn pixel(model: &PointModes<MODES>, index: usize, x: &SVector<f64, 13>) -> Option<Vector2<f64>> {
        let camera = CameraFrame::new(&Vector4::new(x[0], x[1], x[2], x[3]));
        let standing = Standing { anchor: Vector2::new(x[10], x[11]), heading: x[12] };
        let shape = Shape::from_fn(|j, _| x[4 + j]);
        StandingFrame::new(&camera, &standing)?.project(&model.point(index, &shape))
    }

    /// Random camera, shape, anchor and heading.
    fn random(rng: &mut Rng) -> SVector<f64, 13> {
        let mut x = SVector::zeros();
        x[0] = rng.uniform(600.0, 8000.0).ln();
        x[1] = rng.uniform(0.05, 1.3);
        x[2] = rng.uniform(-0.3, 0.3);
        x[3] = rng.uniform(4.0, 30.0).ln();
        for j in 0..MODES {
            x[4 + j] = rng.normal();
        }
        x[10] = rng.uniform(-900.0, 900.0);
        x[11] = rng.uniform(-300.0, 500.0);
        x[12] = rng.uniform(-4.0, 4.0);
        x
    }

    #[test]
    fn projection_agrees_with_base_and_the_ground_pose_with_its_derivative() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let model = PointModes::new(&atlas);
        let mut rng = Rng::new(17);
        let mut checked = 0;
        while checked < 1000 {
            let x = random(&mut rng);
            let params = CameraParams::from_vector(&Vector4::new(x[0], x[1], x[2], x[3]));
            let camera = CameraFrame::new(&params.to_vector());
            let standing = Standing { anchor: Vector2::new(x[10], x[11]), heading: x[12] };
            let Some(frame) = StandingFrame::new(&camera, &standing) else { continue };
            if !(3.0..300.0).contains(&frame.origin.z) {
                continue;
            }
            checked += 1;
            let (pose, by) = frame.ground_pose(&camera, standing.heading);
            let back = camera.anchor_of(&pose).unwrap();
            assert!((back - standing.anchor).norm() < 1e-6);
            let shape = Shape::from_fn(|j, _| x[4 + j]);
            let in_camera = params.plane().camera_from_world()
                * pose.world_from_car()
                * nalgebra::Point3::from(atlas.keypoint_in_car(7, &shape));
            let base = roadplane_base::Camera::pinhole(params.focal_px(), Vector2::zeros());
            if let (Some(a), Some(b)) = (base.pixel_from_camera(&in_camera.coords), pixel(&model, 7, &x)) {
                assert!((a - b).norm() < 1e-6);
            }
            for (k, column) in [0, 1, 2, 3, 10, 11, 12].into_iter().enumerate() {
                let h = 1e-6 * if (10..12).contains(&column) { 100.0 } else { 1.0 };
                let moved = |sign: f64| {
                    let mut x = x;
                    x[column] += sign * h;
                    let camera = CameraFrame::new(&Vector4::new(x[0], x[1], x[2], x[3]));
                    let standing = Standing { anchor: Vector2::new(x[10], x[11]), heading: x[12] };
                    Some(StandingFrame::new(&camera, &standing)?.ground_pose(&camera, x[12]).0)
                };
                let (Some(plus), Some(minus)) = (moved(1.0), moved(-1.0)) else { continue };
                let numeric = Vector3::new(
                    plus.x_m - minus.x_m,
                    plus.y_m - minus.y_m,
                    wrap_angle(plus.heading_rad - minus.heading_rad),
                ) / (2.0 * h);
                let analytic = by.column(k).into_owned();
                let off = (numeric - analytic).norm();
                assert!(
                    off < 1e-4 * (1.0 + analytic.norm()),
                    "column {column}: {analytic} against {numeric}"
                );
            }
        }
    }
}
