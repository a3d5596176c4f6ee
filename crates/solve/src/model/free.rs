//! Projection of a keypoint of a car anywhere in space, and the paper's plane terms, with their Jacobians.
//!
//! ```text
//! X_cam = T + R X(λ),    T = e^ρ (u, v, f),    R ← exp([ω]×) R      (perturbation on the left, camera frame)
//! D_p2p = n · T + h                                                 paper Eq. 4, m
//! D_v2v = R ẑ − n,   ‖D_v2v‖ = 2 sin(θ/2) ≈ θ                       paper Eq. 5, rad; unlike its arcsin ‖n × R ẑ‖ it does
//!                                                                   not take a car on its roof for one on its wheels
//! ```
//!
//! (u, v) is the image of the car's origin relative to the principal point, e^ρ its depth over the focal length. So a change
//! of f alone moves T along (x, y, λ z): the paper's finding 2 (§4.2), the direction that costs (nearly) no reprojection
//! error, is a coordinate. Columns `[log f, tilt, roll, log h | λ_1 … λ_6 | ω_x, ω_y, ω_z | u, v, ρ]`.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector2, Vector3};
use roadplane_base::{MODES, Shape};

use crate::model::ground::CameraFrame;

/// Derivatives by camera, shape and pose, padded to whole SIMD registers.
pub(crate) type Row = [f64; 16];

/// Nearest depth at which a keypoint is evaluated, m.
const MIN_DEPTH_M: f64 = 0.1;

/// A car anywhere.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FreeCar {
    pub camera_from_car: UnitQuaternion<f64>,
    /// Image of the car's origin, px from the principal point.
    pub anchor: Vector2<f64>,
    /// Logarithm of depth over focal length.
    pub log_depth_ratio: f64,
    pub shape: Shape,
}

impl FreeCar {
    /// Car's origin in the camera frame, m.
    pub fn origin(&self, focal_px: f64) -> Vector3<f64> {
        Vector3::new(self.anchor.x, self.anchor.y, focal_px) * self.log_depth_ratio.exp()
    }

    /// Moved by a step in the columns after the camera's.
    pub fn moved(&self, step: &nalgebra::SVector<f64, 12>) -> Self {
        let omega = Vector3::new(step[6], step[7], step[8]);
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::new(omega));
        let mut camera_from_car = turn * self.camera_from_car;
        camera_from_car.renormalize_fast();
        Self {
            camera_from_car,
            anchor: self.anchor + Vector2::new(step[9], step[10]),
            log_depth_ratio: self.log_depth_ratio + step[11],
            shape: self.shape + step.fixed_rows::<MODES>(0),
        }
    }
}

/// A car's place with what its keypoints share.
pub(crate) struct FreeFrame {
    focal_px: f64,
    pub origin: Vector3<f64>,
    pub camera_from_car: Matrix3<f64>,
    depth_ratio: f64,
}

impl FreeFrame {
    pub fn new(focal_px: f64, car: &FreeCar) -> Self {
        Self {
            focal_px,
            origin: car.origin(focal_px),
            camera_from_car: car.camera_from_car.to_rotation_matrix().into_inner(),
            depth_ratio: car.log_depth_ratio.exp(),
        }
    }

    /// Pixel relative to the principal point; `None` at or behind the camera.
    pub fn project(&self, point_in_car: &Vector3<f64>) -> Option<Vector2<f64>> {
        let p = self.origin + self.camera_from_car * point_in_car;
        (p.z > MIN_DEPTH_M).then(|| p.xy() * (self.focal_px / p.z))
    }

    /// The pixel with its Jacobian (2 × 16, px per unit).
    pub fn project_with_jacobian(
        &self,
        point_in_car: &Vector3<f64>,
        modes: &[Vector3<f64>; MODES],
    ) -> Option<(Vector2<f64>, [Row; 2])> {
        let offset = self.camera_from_car * point_in_car;
        let p = self.origin + offset;
        if p.z.is_nan() || p.z <= MIN_DEPTH_M {
            return None;
        }
        let scale = self.focal_px / p.z;
        let pixel = p.xy() * scale;
        let by_point = |d: Vector3<f64>| [scale * (d.x - p.x / p.z * d.z), scale * (d.y - p.y / p.z * d.z)];
        let mut rows = [[0.0; 16]; 2];
        let mut put = |column: usize, value: [f64; 2]| {
            rows[0][column] = value[0];
            rows[1][column] = value[1];
        };
        let by_focal = by_point(Vector3::new(0.0, 0.0, self.origin.z));
        put(0, [by_focal[0] + pixel.x, by_focal[1] + pixel.y]);
        for (j, mode) in modes.iter().enumerate() {
            put(4 + j, by_point(self.camera_from_car * mode));
        }
        put(10, by_point(Vector3::new(0.0, -offset.z, offset.y)));
        put(11, by_point(Vector3::new(offset.z, 0.0, -offset.x)));
        put(12, by_point(Vector3::new(-offset.y, offset.x, 0.0)));
        put(13, by_point(Vector3::new(self.depth_ratio, 0.0, 0.0)));
        put(14, by_point(Vector3::new(0.0, self.depth_ratio, 0.0)));
        put(15, by_point(self.origin));
        Some((pixel, rows))
    }

    /// `(D_p2p, D_v2v)`: one distance in m and three components in rad, with their Jacobian (4 × 16).
    pub fn plane_terms(&self, camera: &CameraFrame) -> ([f64; 4], [Row; 4]) {
        let normal = camera.camera_from_world.column(2).into_owned();
        let by_tilt = -camera.camera_from_world.column(1).into_owned();
        let by_roll = Vector3::new(-normal.y, normal.x, 0.0);
        let up = self.camera_from_car.column(2).into_owned();
        let off = up - normal;
        let mut rows = [[0.0; 16]; 4];
        rows[0][0] = normal.z * self.origin.z;
        rows[0][1] = by_tilt.dot(&self.origin);
        rows[0][2] = by_roll.dot(&self.origin);
        rows[0][3] = camera.height_m;
        rows[0][13] = normal.x * self.depth_ratio;
        rows[0][14] = normal.y * self.depth_ratio;
        rows[0][15] = normal.dot(&self.origin);
        // ∂(exp([ω]×) up) = ω × up
        let turns =
            [Vector3::new(0.0, -up.z, up.y), Vector3::new(up.z, 0.0, -up.x), Vector3::new(-up.y, up.x, 0.0)];
        for i in 0..3 {
            rows[1 + i][1] = -by_tilt[i];
            rows[1 + i][2] = -by_roll[i];
            for (k, turn) in turns.iter().enumerate() {
                rows[1 + i][10 + k] = turn[i];
            }
        }
        ([normal.dot(&self.origin) + camera.height_m, off.x, off.y, off.z], rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::dual::{
        Dual, Vector, constant, cross, dot, plus, relative_difference, scaled, world_axes,
    };
    use crate::model::ground::PointModes;
    use nalgebra::{SVector, Vector4};
    use roadplane_base::ShapeAtlas;
    use roadplane_synth::Rng;

    /// The module's model, written once more in dual numbers around (camera, car): pixel and plane terms.
    fn exact(model: &PointModes, index: usize, camera: &Vector4<f64>, car: &FreeCar) -> [Dual; 6] {
        let at = |value: f64, index: usize| Dual::unknown(value, index);
        let f = at(camera[0], 0).exp();
        let [_, _, up] = world_axes(at(camera[1], 1), at(camera[2], 2));
        let h = at(camera[3], 3).exp();
        let ratio = at(car.log_depth_ratio, 15).exp();
        let origin = scaled([at(car.anchor.x, 13), at(car.anchor.y, 14), f], ratio);
        // To first order exp([ω]×) v = v + ω × v, which is all that a derivative at ω = 0 needs.
        let omega = [10, 11, 12].map(|i| at(0.0, i));
        let turned = |v: Vector| {
            let r = car.camera_from_car.to_rotation_matrix().into_inner();
            let v: Vector = std::array::from_fn(|i| dot(constant(&r.row(i).transpose()), v));
            plus(v, cross(omega, v))
        };
        let mut point = constant(&model.mean[index]);
        for (j, mode) in model.modes[index].iter().enumerate() {
            point = plus(point, scaled(constant(mode), at(car.shape[j], 4 + j)));
        }
        let p = plus(origin, turned(point));
        let tip = turned(constant(&Vector3::z()));
        [
            f * p[0] / p[2],
            f * p[1] / p[2],
            dot(up, origin) + h,
            tip[0] - up[0],
            tip[1] - up[1],
            tip[2] - up[2],
        ]
    }

    #[test]
    fn jacobians_are_the_derivatives_to_1e_9() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let model = PointModes::new(&atlas);
        let mut rng = Rng::new(4);
        let mut checked = 0;
        while checked < 1000 {
            let index = (rng.unit() * 36.0) as usize;
            let camera = Vector4::new(
                rng.uniform(600.0, 8000.0).ln(),
                rng.uniform(0.0, 1.2),
                rng.uniform(-0.3, 0.3),
                2.0,
            );
            let car = FreeCar {
                camera_from_car: UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| rng.normal())),
                anchor: Vector2::new(rng.uniform(-900.0, 900.0), rng.uniform(-500.0, 500.0)),
                log_depth_ratio: -rng.uniform(15.0, 150.0).ln(),
                shape: Shape::from_fn(|_, _| rng.normal()),
            };
            let frame = CameraFrame::new(&camera);
            let free = FreeFrame::new(frame.focal_px, &car);
            let point = model.point(index, &car.shape);
            let Some((pixel, [x, y])) = free.project_with_jacobian(&point, &model.modes[index]) else {
                continue;
            };
            let (terms, [distance, a, b, c]) = free.plane_terms(&frame);
            let values = [pixel.x, pixel.y, terms[0], terms[1], terms[2], terms[3]];
            let exact = exact(&model, index, &camera, &car);
            for ((exact, value), row) in exact.iter().zip(values).zip([x, y, distance, a, b, c]) {
                assert!((exact.value - value).abs() < 1e-9 * (1.0 + value.abs()), "{} {value}", exact.value);
                let off = relative_difference(&exact.by, &row);
                assert!(off < 1e-9, "{off}: {:?} against {row:?}", exact.by);
            }
            checked += 1;
        }
    }

    #[test]
    fn a_step_moves_as_its_columns_say() {
        let mut rng = Rng::new(5);
        let car = FreeCar {
            camera_from_car: UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| rng.normal())),
            anchor: Vector2::new(30.0, -20.0),
            log_depth_ratio: -3.0,
            shape: Shape::zeros(),
        };
        let step = SVector::<f64, 12>::from_fn(|_, _| 1e-6 * rng.normal());
        let moved = car.moved(&step);
        let turn = moved.camera_from_car * car.camera_from_car.inverse();
        assert!((turn.scaled_axis() - step.fixed_rows::<3>(6)).norm() < 1e-12);
        assert!((moved.shape - step.fixed_rows::<MODES>(0)).norm() < 1e-15);
        assert!((moved.anchor - car.anchor - step.fixed_rows::<2>(9)).norm() < 1e-12);
        assert!((moved.log_depth_ratio - car.log_depth_ratio - step[11]).abs() < 1e-12);
    }
}
