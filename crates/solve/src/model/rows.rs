//! The inner loop: computes cost and normal equations of a view from its keypoints, four at a time.
//!
//! Each keypoint has two rows: the derivatives of its pixel coordinates and their residuals (`pose.rs` has the model).
//! Rows are whitened and multiplied by the root of the keypoint's weight. Their columns are
//!
//! ```text
//! pose | shape coefficients λ_1 … λ_M | log f, tilt, roll, log h | residual
//! ```
//!
//! Because the residual is the last column, the sum `Σ rowᵀ row` contains both Hessian and gradient.

use nalgebra::SVector;

#[cfg(target_arch = "x86_64")]
use crate::linear::gram::accumulate_avx2;
use crate::linear::gram::{Gram, MAX_WIDTH, Rows, accumulate};
use crate::linear::lanes::{LANES, Lanes, cross, dot, splat, sum, turned};
use crate::model::kernel::{OutlierModel, PreparedKernel};
use crate::model::pack::Pack;
use crate::model::pose::{CarFrame, MIN_DEPTH_M, Twist};

/// Largest number of packs (four keypoints each) of a view.
pub(crate) const MAX_PACKS: usize = roadplane_base::KEYPOINTS.div_ceil(LANES);
/// Rows of four keypoints, filled with zeros.
pub(crate) const NO_ROWS: Rows = [[Lanes::splat(0.0); MAX_WIDTH]; 2];

/// Computes a view's normal equations and returns the cost of its keypoints.
///
/// Returns `None` if a keypoint is at or behind the camera. `scratch` stores the rows.
pub(crate) fn linearise<const N: usize, const M: usize>(
    packs: &[Pack<M>],
    frame: &CarFrame<N>,
    shape: &SVector<f64, M>,
    kernel: &PreparedKernel,
    scratch: &mut [Rows; MAX_PACKS],
    gram: &mut Gram<N, M>,
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

/// Computes the same numbers as [`linearise`], with AVX2 instructions.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn linearise_avx2<const N: usize, const M: usize>(
    packs: &[Pack<M>],
    frame: &CarFrame<N>,
    shape: &SVector<f64, M>,
    kernel: &PreparedKernel,
    scratch: &mut [Rows; MAX_PACKS],
    gram: &mut Gram<N, M>,
) -> Option<f64> {
    let cost = all_rows(packs, frame, shape, kernel, scratch)?;
    accumulate_avx2(&scratch[..packs.len().min(MAX_PACKS)], gram);
    Some(cost)
}

/// Calls `see` with the index and the rows of each keypoint of a view.
///
/// The rows are multiplied by the root of the keypoint's weight, but not by the outlier model's weight. Returns `None`
/// if a keypoint is at or behind the camera.
pub(crate) fn plain_rows<const N: usize, const M: usize>(
    packs: &[Pack<M>],
    frame: &CarFrame<N>,
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

#[inline(always)]
fn all_rows<const N: usize, const M: usize>(
    packs: &[Pack<M>],
    frame: &CarFrame<N>,
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
    /// Computes the whitened and weighted rows of the four keypoints, and returns their costs.
    #[inline(always)]
    fn rows<const N: usize>(
        &self,
        frame: &CarFrame<N>,
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
        for (row, by) in rows.iter_mut().zip(&by_camera) {
            // The same row in the axes of the car frame.
            let by_car = turned(&frame.camera_from_car.transpose(), by);
            // A turn about the origin: by · (turn × offset) = turn · (offset × by).
            let moment = cross(&offset, by);
            let by_unknown =
                |twist: &Twist| dot(by, &splat(&twist.shift)) + dot(&moment, &splat(&twist.turn));
            for (entry, twist) in row.iter_mut().zip(&frame.by_pose) {
                *entry = by_unknown(twist);
            }
            for (entry, mode) in row[N..].iter_mut().zip(&self.modes) {
                *entry = dot(&by_car, mode);
            }
            for (entry, twist) in row[N + M..].iter_mut().zip(&frame.by_camera) {
                *entry = by_unknown(twist);
            }
            row[N + M] = row[N + M] + by[0] * p[0] + by[1] * p[1];
        }
        rows[0][Gram::<N, M>::RESIDUAL] = root * off_sds[0];
        rows[1][Gram::<N, M>::RESIDUAL] = root * off_sds[1];
        Some(Lanes::splat(0.5) * self.weight * loss)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::free::FreePose;
    use crate::model::observation::Observation;
    use crate::model::on_plane::PlanePose;
    use crate::model::pack::pack;
    use crate::model::points::PointModes;
    use crate::model::pose::{CameraFrame, Pose};
    use nalgebra::{Matrix2, UnitQuaternion, Vector2, Vector4};
    use roadplane_base::ShapeAtlas;
    use roadplane_synth::Rng;

    /// Checks the cost and the normal equations of a view.
    ///
    /// The equations must be sums of products of rows, and their bits must be the same with and without AVX2.
    fn check<P: Pose<N>, const N: usize, const M: usize>(model: &PointModes<M>, pose: P) {
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
        pack(model, &observations, &mut packs);
        let frame = pose.frame(&CameraFrame::new(&Vector4::new(7.0, 0.4, 0.02, 2.0))).unwrap();
        let shape = SVector::from_fn(|_, _| rng.normal());
        let mut scratch = [NO_ROWS; MAX_PACKS];
        let (mut fast, mut plain) = (Gram::<N, M>::zeros(), Gram::<N, M>::zeros());
        let cost = linearise(&packs, &frame, &shape, &kernel, &mut scratch, &mut fast).unwrap();
        let same = all_rows(&packs, &frame, &shape, &kernel, &mut scratch).unwrap();
        let rows = &scratch[..packs.len()];
        accumulate(rows, &mut plain);
        assert_eq!(cost.to_bits(), same.to_bits());
        for i in 0..Gram::<N, M>::RESIDUAL {
            for j in i..=Gram::<N, M>::RESIDUAL {
                assert_eq!(fast.rows[i][j].to_bits(), plain.rows[i][j].to_bits(), "({i}, {j})");
                let sum: f64 = rows.iter().flatten().map(|row| (row[i] * row[j]).sum()).sum();
                assert!((plain.rows[i][j] - sum).abs() <= 1e-12 * (1.0 + sum.abs()), "({i}, {j})");
            }
        }
        let cost_of = |o: &Observation| {
            let off = frame.project(&model.point(o.index, &shape)).unwrap() - o.pixel;
            let [x, y] = o.whiten([off.x, off.y]);
            0.5 * o.weight * OutlierModel::default().cost(x * x + y * y)
        };
        assert!((cost / observations.iter().map(cost_of).sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn normal_equations_are_sums_of_products_and_the_same_bits_both_ways() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let plane_pose = PlanePose { anchor: Vector2::new(20.0, 30.0), heading: 0.7 };
        check(&PointModes::new(&atlas), plane_pose);
        check(&PointModes::of_all_modes(&atlas), plane_pose);
        let camera_from_car = UnitQuaternion::from_euler_angles(1.0, 0.2, 0.3);
        check(
            &PointModes::new(&atlas),
            FreePose { camera_from_car, anchor: plane_pose.anchor, log_depth_ratio: -4.0 },
        );
    }
}
