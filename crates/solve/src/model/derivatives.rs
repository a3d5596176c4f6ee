//! Tests of the analytic Jacobians against derivatives that are exact up to rounding.
//!
//! The tests contain a second version of the model, in complex numbers. With a tiny step h, the derivative of a
//! function f is Im f(x + ih) / h up to rounding (Squire and Trapp 1998, SIAM Rev. 40).

use nalgebra::{Complex, Matrix2, Matrix3, SVector, UnitQuaternion, Vector2, Vector3, Vector4};
use roadplane_base::{Camera, CameraParams, KEYPOINTS, ShapeAtlas};
use roadplane_synth::Rng;

use crate::linear::gram::Gram;
use crate::model::free::{FREE, FreePose, PlaneTerms};
use crate::model::observation::Observation;
use crate::model::on_plane::{ON_PLANE, PlanePose};
use crate::model::pack::pack;
use crate::model::points::PointModes;
use crate::model::pose::{CameraFrame, Pose};
use crate::model::rows::plain_rows;

type Number = Complex<f64>;

/// Returns the K values of f at x, each with its derivatives with respect to all entries of x.
fn derivatives<const K: usize>(x: &[f64], f: impl Fn(&[Number]) -> [Number; K]) -> [(f64, Vec<f64>); K] {
    const STEP: f64 = 1e-30;
    let with_step = |unknown: usize| {
        let step = |i: usize| if i == unknown { STEP } else { 0.0 };
        let x: Vec<Number> = x.iter().enumerate().map(|(i, x)| Number::new(*x, step(i))).collect();
        f(&x)
    };
    let by: Vec<[Number; K]> = (0..x.len()).map(with_step).collect();
    std::array::from_fn(|k| (by[0][k].re, by.iter().map(|values| values[k].im / STEP).collect()))
}

fn assert_close(exact: &[f64], found: &[f64]) {
    let largest = exact.iter().fold(1.0_f64, |most, v| most.max(v.abs()));
    for (a, b) in exact.iter().zip(found) {
        assert!((a - b).abs() < 1e-9 * a.abs().max(1e-3 * largest), "{exact:?} against {found:?}");
    }
}

/// Returns the axes of the world frame in camera coordinates. The columns are right, forward and up.
fn world(tilt: Number, roll: Number) -> Matrix3<Number> {
    let (st, ct, sr, cr, zero) = (tilt.sin(), tilt.cos(), roll.sin(), roll.cos(), Number::ZERO);
    Matrix3::new(cr, sr * st, sr * ct, sr, -cr * st, -cr * ct, zero, ct, -st)
}

fn complex(v: &Vector3<f64>) -> Vector3<Number> {
    v.map(|v| Number::new(v, 0.0))
}

/// A pose with a second version of its model, in complex numbers.
trait Written<const N: usize>: Pose<N> {
    fn random(rng: &mut Rng) -> Self;
    /// Returns the values of the pose's unknowns, at which derivatives are computed.
    fn unknowns(&self) -> [f64; N];
    /// Returns the car's origin and rotation in the camera frame.
    ///
    /// `pose` contains the pose's unknowns, and `camera` is (log f, tilt, roll, log h).
    fn place(&self, pose: &[Number], camera: &[Number]) -> (Vector3<Number>, Matrix3<Number>);
}

impl Written<ON_PLANE> for PlanePose {
    fn random(rng: &mut Rng) -> Self {
        let anchor = Vector2::new(rng.uniform(-900.0, 900.0), rng.uniform(-300.0, 500.0));
        Self { anchor, heading: rng.uniform(-4.0, 4.0) }
    }

    fn unknowns(&self) -> [f64; ON_PLANE] {
        [self.anchor.x, self.anchor.y, self.heading]
    }

    fn place(&self, pose: &[Number], camera: &[Number]) -> (Vector3<Number>, Matrix3<Number>) {
        let (f, world, (one, zero)) =
            (camera[0].exp(), world(camera[1], camera[2]), (Number::ONE, Number::ZERO));
        let ray = Vector3::new(pose[0] / f, pose[1] / f, one);
        let (sin, cos) = (pose[2].sin(), pose[2].cos());
        let turn = Matrix3::new(cos, -sin, zero, sin, cos, zero, zero, zero, one);
        (ray * (-camera[3].exp() / world.column(2).dot(&ray)), world * turn)
    }
}

impl Written<FREE> for FreePose {
    fn random(rng: &mut Rng) -> Self {
        Self {
            camera_from_car: UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| rng.normal())),
            anchor: Vector2::new(rng.uniform(-900.0, 900.0), rng.uniform(-500.0, 500.0)),
            log_depth_ratio: -rng.uniform(15.0, 150.0).ln(),
        }
    }

    fn unknowns(&self) -> [f64; FREE] {
        [0.0, 0.0, 0.0, self.anchor.x, self.anchor.y, self.log_depth_ratio]
    }

    fn place(&self, pose: &[Number], camera: &[Number]) -> (Vector3<Number>, Matrix3<Number>) {
        let origin = Vector3::new(pose[3], pose[4], camera[0].exp()) * pose[5].exp();
        // exp([ω]×) to first order in the rotation vector ω. This is enough for a derivative at ω = 0.
        let turn = Matrix3::identity() + Vector3::new(pose[0], pose[1], pose[2]).cross_matrix();
        let own = self.camera_from_car.to_rotation_matrix().into_inner();
        (origin, turn * own.map(|v| Number::new(v, 0.0)))
    }
}

/// Calls `see` 1000 times with a random camera and a random pose at a depth of 3 to 300 m.
fn each_random<P: Written<N>, const N: usize>(seed: u64, mut see: impl FnMut(&mut Rng, &Vector4<f64>, P)) {
    let mut rng = Rng::new(seed);
    let mut seen = 0;
    while seen < 1000 {
        let [log_focal, log_height] = [[600.0, 8000.0], [4.0, 30.0]].map(|[a, b]| rng.uniform(a, b).ln());
        let camera = Vector4::new(log_focal, rng.uniform(0.05, 1.3), rng.uniform(-0.3, 0.3), log_height);
        let pose = P::random(&mut rng);
        let frame = pose.frame(&CameraFrame::new(&camera));
        if frame.is_some_and(|frame| (3.0..300.0).contains(&frame.origin.z)) {
            see(&mut rng, &camera, pose);
            seen += 1;
        }
    }
}

/// Checks residuals and derivatives of keypoints and of plane terms against the complex model.
fn check_rows<P: Written<N>, const N: usize, const M: usize>(model: &PointModes<M>) {
    let terms = PlaneTerms { distance_sd_m: 0.5, angle_sd: 0.2 };
    each_random(16, |rng, camera, pose: P| {
        let index = (rng.unit() * KEYPOINTS as f64) as usize;
        let shape = SVector::<f64, M>::from_fn(|_, _| rng.normal());
        let mut observation = Observation {
            index,
            pixel: Vector2::new(rng.normal(), rng.normal()),
            by_lens: Vector2::zeros(),
            covariance: Matrix2::new(4.0, 1.0, 1.0, 2.0),
            weight: 0.7,
            whitening: [0.0; 3],
        };
        observation.whiten_with(&Matrix2::zeros());
        let x: Vec<f64> = pose.unknowns().iter().chain(shape.iter()).chain(camera.iter()).copied().collect();
        let exact = derivatives(&x, |x| {
            let camera = &x[N + M..];
            let (origin, turn) = pose.place(&x[..N], camera);
            let modes = model.modes[index].iter().zip(&x[N..]);
            let point = modes.fold(complex(&model.mean[index]), |sum, (mode, x)| sum + complex(mode) * *x);
            let p = origin + turn * point;
            let off = [0, 1].map(|i| camera[0].exp() * p[i] / p[2] - observation.pixel[i]);
            let ([w00, w10, w11], root) = (observation.whitening, observation.weight.sqrt());
            let up = world(camera[1], camera[2]).column(2).into_owned();
            let distance = up.dot(&origin) + camera[3].exp();
            let tip = turn.column(2) - up;
            let angles = [0, 1, 2].map(|i| tip[i] / terms.angle_sd);
            let [x, y] = [off[0] * w00 * root, (off[0] * w10 + off[1] * w11) * root];
            [x, y, distance / terms.distance_sd_m, angles[0], angles[1], angles[2]]
        });
        let camera = CameraFrame::new(camera);
        let frame = pose.frame(&camera).unwrap();
        let mut packs = Vec::new();
        pack(model, &[observation], &mut packs);
        let mut rows = Vec::new();
        if plain_rows(&packs, &frame, &shape, |_, of_keypoint| rows.extend(of_keypoint)).is_some() {
            rows.extend(terms.rows::<N, M>(&camera, &frame));
            for ((value, by), row) in exact.iter().zip(&rows) {
                let found = row[Gram::<N, M>::RESIDUAL];
                assert!((value - found).abs() < 1e-9 * (1.0 + value.abs()), "{value} {found}");
                assert_close(by, &row[..N + M + 4]);
            }
        }
    });
}

#[test]
fn rows_are_the_derivatives_to_1e_9() {
    let atlas = ShapeAtlas::shipped().unwrap();
    check_rows::<PlanePose, ON_PLANE, _>(&PointModes::new(&atlas));
    check_rows::<PlanePose, ON_PLANE, _>(&PointModes::of_all_modes(&atlas));
    check_rows::<FreePose, FREE, _>(&PointModes::new(&atlas));
}

#[test]
fn a_step_moves_a_car_as_its_columns_predict() {
    fn check<P: Written<N>, const N: usize>() {
        each_random(5, |rng, camera, pose: P| {
            let camera = CameraFrame::new(camera);
            let step: [f64; N] = std::array::from_fn(|_| 1e-7 * rng.normal());
            let (before, after) = (pose.frame(&camera).unwrap(), pose.moved(&step).frame(&camera).unwrap());
            let moves = before.by_pose.iter().zip(step);
            let (shift, turn) = moves.fold((Vector3::zeros(), Vector3::zeros()), |sums, (twist, step)| {
                (sums.0 + twist.shift * step, sums.1 + twist.turn * step)
            });
            assert!((after.origin - before.origin - shift).norm() < 1e-10 * (1.0 + before.origin.norm()));
            let turned = (Matrix3::identity() + turn.cross_matrix()) * before.camera_from_car;
            assert!((after.camera_from_car - turned).norm() < 1e-12);
        });
    }
    check::<PlanePose, ON_PLANE>();
    check::<FreePose, FREE>();
}

#[test]
fn poses_on_the_plane_agree_with_base_and_have_exact_derivatives() {
    let atlas = ShapeAtlas::shipped().unwrap();
    each_random(17, |_, camera, plane_pose: PlanePose| {
        let x: Vec<f64> = plane_pose.unknowns().iter().chain(camera.iter()).copied().collect();
        let exact = derivatives(&x, |x| {
            let (origin, _) = plane_pose.place(&x[..3], &x[3..]);
            let at = world(x[4], x[5]).tr_mul(&origin);
            [at.x, at.y, x[2]]
        });
        let (params, camera) = (CameraParams::from_vector(camera), CameraFrame::new(camera));
        let frame = plane_pose.frame(&camera).unwrap();
        let (pose, by) = plane_pose.on_ground(&frame, &camera);
        for (i, (_, exact)) in exact.iter().enumerate() {
            assert_close(exact, by.row(i).transpose().as_slice());
        }
        assert!((PlanePose::of(&pose, &camera).unwrap().anchor - plane_pose.anchor).norm() < 1e-6);
        let in_car = atlas.mean[7];
        let in_camera =
            params.plane().camera_from_world() * pose.world_from_car() * nalgebra::Point3::from(in_car);
        let base = Camera::pinhole(params.focal_px(), Vector2::zeros()).pixel_from_camera(&in_camera.coords);
        if let (Some(base), Some(pixel)) = (base, frame.project(&in_car)) {
            assert!((base - pixel).norm() < 1e-6);
        }
    });
}
