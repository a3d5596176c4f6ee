//! The inner loop: a view's keypoints, four at a time, to its cost and its normal equations.
//!
//! Rows of the Jacobian (see `ground.rs` for the model), whitened and multiplied with the root of the keypoint's
//! weight, have the order in which unknowns are eliminated: `[a_u, a_v, ψ | λ_1 … λ_M | log f, tilt, roll, log h | residual]`.
//! With the residual as the last column, `Σ rowᵀ row` holds Hessian and gradient.

use nalgebra::SVector;

use crate::linear::gram::{Gram, MAX_WIDTH, Rows, SHAPE, accumulate, accumulate_avx2, camera, residual};
#[cfg(target_arch = "x86_64")]
use crate::linear::lanes::{LANES, Lanes, dot, splat, sum, turned};
use crate::model::ground::{MIN_DEPTH_M, StandingFrame};
use crate::model::kernel::{OutlierModel, PreparedKernel};
use crate::model::pack::Pack;

/// Packs that a view can have.
pub(crate) const MAX_PACKS: usize = roadplane_base::KEYPOINTS.div_ceil(LANES);
/// Rows of four keypoints that have not been worked out.
pub(crate) const NO_ROWS: Rows = [[Lanes::splat(0.0); MAX_WIDTH]; 2];

/// Cost of a view's keypoints at a place and shape; sets its normal equations. `None` when a keypoint is at or behind the
/// camera. `scratch` is for the rows in between.
pub(crate) fn linearise<const M: usize>(
    packs: &[Pack<M>],
    frame: &StandingFrame,
    shape: &SVector<f64, M>,
    kernel: &PreparedKernel,
    scratch: &mut [Rows; MAX_PACKS],
    gram: &mut Gram<M>,
) -> Option<f64> {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        #[allow(unsafe_code)]
        return unsafe { linearise_avx2(packs, frame, shape, kernel, scratch, gram) };
    }
    let cost = all_rows(packs, frame, shape, kernel, scratch)?;
    accumulate(&scratch[..packs.len().min(MAX_PACKS)], gram);
    Some(cost)
}

/// Rows of a view's keypoints one by one, each with its own weight only (no outlier model).
pub(crate) fn plain_rows<const M: usize>(
    packs: &[Pack<M>],
    frame: &StandingFrame,
    shape: &SVector<f64, M>,
    mut see: impl FnMut(usize, &[[f64; MAX_WIDTH]; 2]),
) -> Option<()> {
    let kernel = PreparedKernel::new(&OutlierModel::none());
    let mut rows = NO_ROWS;
    for (p, pack) in packs.iter().enumerate() {
        pack.rows(frame, shape, &kernel, &mut rows)?;
        for lane in (0..LANES).filter(|lane| pack.weight.0[*lane] > 0.0) {
            see(LANES * p + lane, &[0, 1].map(|row: usize| rows[row].map(|lanes| lanes.0[lane])));
        }
    }
    Some(())
}

/// The same with four-lane registers.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn linearise_avx2<const M: usize>(
    packs: &[Pack<M>],
    frame: &StandingFrame,
    shape: &SVector<f64, M>,
    kernel: &PreparedKernel,
    scratch: &mut [Rows; MAX_PACKS],
    gram: &mut Gram<M>,
) -> Option<f64> {
    let cost = all_rows(packs, frame, shape, kernel, scratch)?;
    accumulate_avx2(&scratch[..packs.len().min(MAX_PACKS)], gram);
    Some(cost)
}

#[inline(always)]
fn all_rows<const M: usize>(
    packs: &[Pack<M>],
    frame: &StandingFrame,
    shape: &SVector<f64, M>,
    kernel: &PreparedKernel,
    scratch: &mut [Rows; MAX_PACKS],
) -> Option<f64> {
    let mut cost = Lanes::default();
    for (pack, rows) in packs.iter().zip(scratch.iter_mut()) {
        cost += pack.rows(frame, shape, kernel, rows)?;
    }
    Some(cost.sum())
}

impl<const M: usize> Pack<M> {
    /// Whitened, weighted rows; returns the keypoints' costs.
    #[inline(always)]
    fn rows(
        &self,
        frame: &StandingFrame,
        shape: &SVector<f64, M>,
        kernel: &PreparedKernel,
        rows: &mut Rows,
    ) -> Option<Lanes> {
        let mut point = self.mean;
        for (mode, coefficient) in self.modes.iter().zip(shape.iter()) {
            let coefficient = Lanes::splat(*coefficient);
            for axis in 0..3 {
                point[axis] += mode[axis] * coefficient;
            }
        }
        let offset = turned(&frame.camera_from_car, &point);
        let p = sum(&splat(&frame.origin), &offset);
        if !p[2].0.iter().all(|z| *z > MIN_DEPTH_M) {
            return None;
        }
        let inverse_depth = Lanes::splat(1.0) / p[2];
        let (x, y) = (p[0] * inverse_depth, p[1] * inverse_depth);
        let focal = Lanes::splat(frame.focal_px);
        let off = [focal * x - self.pixel[0], focal * y - self.pixel[1]];
        let [w00, w10, w11] = self.whitening;
        let off_sds = [w00 * off[0], w10 * off[0] + w11 * off[1]];
        let (loss, right) = kernel.evaluate(off_sds[0] * off_sds[0] + off_sds[1] * off_sds[1]);
        let root = (self.weight * right).sqrt();
        let scale = focal * inverse_depth * root;
        // Weighted whitening · ∂pixel/∂X_cam, with ∂pixel/∂X_cam = f/z [1 0 −x; 0 1 −y].
        let (a, b0, b1) = (w00 * scale, w10 * scale, w11 * scale);
        let zero = Lanes::default();
        let by_camera = [[a, zero, -(a * x)], [b0, b1, -(b0 * x + b1 * y)]];
        let [by_focal, by_tilt, by_roll, by_height, by_u, by_v] = &frame.origin_by;
        let by_tilt = sum(&splat(by_tilt), &turned(&frame.camera_from_car_by_tilt, &point));
        let by_roll = sum(&splat(by_roll), &[-offset[1], offset[0], zero]);
        for (row, by) in rows.iter_mut().zip(&by_camera) {
            // The same in the car's axes.
            let r = &frame.camera_from_car;
            let along = |axis: usize| {
                by[0] * Lanes::splat(r[(0, axis)])
                    + by[1] * Lanes::splat(r[(1, axis)])
                    + by[2] * Lanes::splat(r[(2, axis)])
            };
            let by_car = [along(0), along(1), along(2)];
            row[0] = dot(by, &splat(by_u));
            row[1] = dot(by, &splat(by_v));
            row[2] = by_car[1] * point[0] - by_car[0] * point[1];
            for (j, mode) in self.modes.iter().enumerate() {
                row[SHAPE + j] = dot(&by_car, mode);
            }
            row[camera(M)] = dot(by, &splat(by_focal)) + by[0] * p[0] + by[1] * p[1];
            row[camera(M) + 1] = dot(by, &by_tilt);
            row[camera(M) + 2] = dot(by, &by_roll);
            row[camera(M) + 3] = dot(by, &splat(by_height));
        }
        rows[0][residual(M)] = root * off_sds[0];
        rows[1][residual(M)] = root * off_sds[1];
        Some(Lanes::splat(0.5) * self.weight * loss)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::dual::{
        Dual, constant, dot as dual_dot, plus, relative_difference, scaled, world_axes,
    };
    use crate::model::ground::{CameraFrame, PointModes, Standing};
    use crate::model::observation::Observation;
    use crate::model::pack::pack;
    use nalgebra::{Matrix2, Vector2, Vector4};
    use roadplane_base::{KEYPOINTS, MODES, ShapeAtlas};
    use roadplane_synth::Rng;

    /// Unknowns in the order of rows: anchor, heading, shape, camera.
    fn random<const M: usize>(rng: &mut Rng) -> Vec<f64> {
        let mut x = vec![rng.uniform(-900.0, 900.0), rng.uniform(-300.0, 500.0), rng.uniform(-4.0, 4.0)];
        x.extend((0..M).map(|_| rng.normal()));
        x.extend([
            rng.uniform(600.0, 8000.0).ln(),
            rng.uniform(0.05, 1.3),
            rng.uniform(-0.3, 0.3),
            rng.uniform(4.0, 30.0).ln(),
        ]);
        x
    }

    /// The module's model, written once more in dual numbers: pixel relative to the principal point.
    fn pixel<const M: usize>(model: &PointModes<M>, index: usize, x: &[f64]) -> [Dual; 2] {
        let x: Vec<Dual> = x.iter().enumerate().map(|(i, value)| Dual::unknown(*value, i)).collect();
        let [log_focal, tilt, roll, log_height] = [0, 1, 2, 3].map(|i| x[camera(M) + i]);
        let (f, h) = (log_focal.exp(), log_height.exp());
        let [right, forward, up] = world_axes(tilt, roll);
        let ray = [x[0] / f, x[1] / f, Dual::constant(1.0)];
        let origin = scaled(ray, h / -dual_dot(up, ray));
        let mut point = constant(&model.mean[index]);
        for (j, mode) in model.modes[index].iter().enumerate() {
            point = plus(point, scaled(constant(mode), x[SHAPE + j]));
        }
        let (sin, cos) = (x[2].sin(), x[2].cos());
        let east = cos * point[0] - sin * point[1];
        let north = sin * point[0] + cos * point[1];
        let offset = plus(plus(scaled(right, east), scaled(forward, north)), scaled(up, point[2]));
        let p = plus(origin, offset);
        [f * p[0] / p[2], f * p[1] / p[2]]
    }

    fn check_rows<const M: usize>(model: &PointModes<M>) {
        let kernel = PreparedKernel::new(&OutlierModel::none());
        let mut rng = Rng::new(16);
        let mut checked = 0;
        while checked < 1000 {
            let x = random::<M>(&mut rng);
            let of_camera = CameraFrame::new(&Vector4::from_column_slice(&x[camera(M)..]));
            let standing = Standing { anchor: Vector2::new(x[0], x[1]), heading: x[2] };
            let Some(frame) = StandingFrame::new(&of_camera, &standing) else { continue };
            if !(3.0..300.0).contains(&frame.origin.z) {
                continue;
            }
            let index = (rng.unit() * KEYPOINTS as f64) as usize;
            let shape = SVector::<f64, M>::from_column_slice(&x[SHAPE..camera(M)]);
            let mut observation = Observation {
                index,
                pixel: Vector2::new(rng.normal(), rng.normal()),
                by_lens: Vector2::zeros(),
                covariance: Matrix2::new(4.0, 1.0, 1.0, 2.0),
                weight: 0.7,
                whitening: [0.0; 3],
            };
            observation.whiten_with(&Matrix2::zeros());
            let mut packs = Vec::new();
            pack(model, &[observation], &mut packs);
            let mut rows = NO_ROWS;
            if packs[0].rows(&frame, &shape, &kernel, &mut rows).is_none() {
                continue;
            }
            let [u, v] = pixel(model, index, &x);
            let root = 0.7_f64.sqrt();
            let [w00, w10, w11] = observation.whitening;
            for (row, [a, b]) in rows.iter().zip([[w00, 0.0], [w10, w11]]) {
                let analytic: Vec<f64> = (0..residual(M)).map(|i| row[i].0[0]).collect();
                let exact: Vec<f64> = (0..residual(M)).map(|i| root * (a * u.by[i] + b * v.by[i])).collect();
                let off = relative_difference(&exact, &analytic);
                assert!(off < 1e-9, "{off}: {exact:?} against {analytic:?}");
                let whitened =
                    root * (a * (u.value - observation.pixel.x) + b * (v.value - observation.pixel.y));
                assert!((row[residual(M)].0[0] - whitened).abs() < 1e-9 * (1.0 + whitened.abs()));
            }
            checked += 1;
        }
    }

    #[test]
    fn rows_are_the_derivatives_to_1e_9() {
        let atlas = ShapeAtlas::shipped().unwrap();
        check_rows(&PointModes::new(&atlas));
        check_rows(&PointModes::of_all_modes(&atlas));
    }

    #[test]
    fn normal_equations_are_the_same_bits_with_and_without_avx2() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let model = PointModes::new(&atlas);
        let kernel = PreparedKernel::new(&OutlierModel::default());
        let mut rng = Rng::new(5);
        let observations: Vec<Observation> = (0..22)
            .map(|index| Observation {
                index,
                pixel: Vector2::new(30.0 * rng.normal(), 30.0 * rng.normal()),
                by_lens: Vector2::zeros(),
                covariance: Matrix2::identity(),
                weight: rng.unit(),
                whitening: [0.1, 0.02, 0.1],
            })
            .collect();
        let mut packs = Vec::new();
        pack(&model, &observations, &mut packs);
        let camera = CameraFrame::new(&Vector4::new(7.0, 0.4, 0.02, 2.0));
        let standing = Standing { anchor: Vector2::new(20.0, 30.0), heading: 0.7 };
        let frame = StandingFrame::new(&camera, &standing).unwrap();
        let shape = roadplane_base::Shape::from_fn(|_, _| rng.normal());
        let mut scratch = [NO_ROWS; MAX_PACKS];
        let (mut fast, mut plain) = (Gram::<MODES>::zeros(), Gram::<MODES>::zeros());
        let cost = linearise(&packs, &frame, &shape, &kernel, &mut scratch, &mut fast).unwrap();
        let same = all_rows(&packs, &frame, &shape, &kernel, &mut scratch).unwrap();
        accumulate(&scratch[..packs.len()], &mut plain);
        assert_eq!(cost.to_bits(), same.to_bits());
        for i in 0..residual(MODES) {
            assert_eq!(fast.rows[i][i..], plain.rows[i][i..]);
        }
        let exact: f64 = observations
            .iter()
            .map(|o| {
                let off = frame.project(&model.point(o.index, &shape)).unwrap() - o.pixel;
                let [x, y] = o.whiten([off.x, off.y]);
                0.5 * o.weight * OutlierModel::default().cost(x * x + y * y)
            })
            .sum();
        assert!((cost / exact - 1.0).abs() < 1e-12);
    }
}
