//! Keypoints as the solver uses them: without distortion, relative to the principal point, whitened and weighted.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use roadplane_base::{Camera, KEYPOINTS, Keypoint, KeypointSet, MIN_KEYPOINTS};

use crate::model::pose::{CarFrame, MIN_DEPTH_M};

/// Least score of a keypoint. A hidden keypoint still has some information, with its wide sd.
const MIN_SCORE: f64 = 0.05;

/// Least sd of a keypoint, px. No measurement is better, and the arithmetic stays stable.
const MIN_SD_PX: f64 = 1e-6;

/// A located keypoint of one view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observation {
    /// Index of the keypoint.
    pub index: usize,
    /// Undistorted position, px from the principal point.
    pub pixel: Vector2<f64>,
    /// Derivative of `pixel` by the lens distortion (1/px²), px³.
    pub by_lens: Vector2<f64>,
    /// Covariance of `pixel` as measured, px².
    pub covariance: Matrix2<f64>,
    /// The paper's `s_i` (Eq. 6): score × weight of the view.
    pub weight: f64,
    /// Whitening: lower triangle (w00, w10, w11) of W with `Wᵀ W = Σ⁻¹`.
    pub whitening: [f64; 3],
}

impl Observation {
    /// Returns the whitened vector `W v`.
    #[inline]
    pub fn whiten(&self, v: [f64; 2]) -> [f64; 2] {
        let [w00, w10, w11] = self.whitening;
        [w00 * v[0], w10 * v[0] + w11 * v[1]]
    }

    /// Sets W from the measured covariance plus `extra` (px²).
    pub fn whiten_with(&mut self, extra: &Matrix2<f64>) {
        let c = self.covariance + extra;
        let l00 = c[(0, 0)].max(MIN_SD_PX * MIN_SD_PX).sqrt();
        let l10 = c[(0, 1)] / l00;
        let l11 = (c[(1, 1)] - l10 * l10).max(MIN_SD_PX * MIN_SD_PX).sqrt();
        self.whitening = [1.0 / l00, -l10 / (l00 * l11), 1.0 / l11];
    }
}

/// Returns the usable keypoints of a car: finite, with a finite score and a positive definite covariance.
///
/// Returns `None` if there are fewer than [`MIN_KEYPOINTS`]. Only lens and principal point of the camera are used.
pub(crate) fn observations(
    keypoints: &KeypointSet,
    camera: &Camera,
    view_weight: f64,
) -> Option<Vec<Observation>> {
    let usable = |p: &Keypoint| {
        let c = &p.covariance_px2;
        p.pixel.iter().chain(c.iter()).all(|v| v.is_finite() && v.abs() < 1e9)
            && c[(0, 0)] > 0.0
            && c.determinant() > 0.0
            && p.score.is_finite()
    };
    let observation = |(index, keypoint): (usize, &Option<Keypoint>)| {
        let p = keypoint.filter(usable)?;
        let distorted = p.pixel - camera.principal_point_px;
        let by_pixel = camera.lens.undistorted_by_pixel(&distorted);
        let mut observation = Observation {
            index,
            pixel: camera.lens.undistorted(&distorted),
            by_lens: camera.lens.undistorted_by_lens(&distorted),
            covariance: by_pixel * p.covariance_px2 * by_pixel.transpose(),
            weight: p.score.clamp(MIN_SCORE, 1.0) * view_weight,
            whitening: [1.0, 0.0, 1.0],
        };
        observation.whiten_with(&Matrix2::zeros());
        Some(observation)
    };
    let found: Vec<Observation> = keypoints.iter().enumerate().filter_map(observation).collect();
    (found.len() >= MIN_KEYPOINTS).then_some(found)
}

/// Whitens a view's observations with their measured covariances, the atlas' residual and `extra_px` in both
/// directions.
///
/// The residual's sd is `scale` × `sd_m` per keypoint. It is projected at the keypoints of the `mean` car.
pub(crate) fn whiten_view<const N: usize>(
    observations: &mut [Observation],
    frame: &CarFrame<N>,
    mean: &[Vector3<f64>; KEYPOINTS],
    sd_m: &[Vector3<f64>; KEYPOINTS],
    scale: f64,
    extra_px: f64,
) {
    for observation in observations {
        let index = observation.index;
        let mut extra = residual_covariance(frame, &mean[index], &(sd_m[index] * scale));
        extra[(0, 0)] += extra_px * extra_px;
        extra[(1, 1)] += extra_px * extra_px;
        observation.whiten_with(&extra);
    }
}

/// Returns the atlas' residual at a point of the car as a covariance in the image, px².
///
/// `sd_m` is the residual's sd along the car's axes. The covariance is `A diag(sd²) Aᵀ` with
/// `A = (f/z) [1 0 −x; 0 1 −y] R`.
fn residual_covariance<const N: usize>(
    frame: &CarFrame<N>,
    point_in_car: &Vector3<f64>,
    sd_m: &Vector3<f64>,
) -> Matrix2<f64> {
    let p = frame.origin + frame.camera_from_car * point_in_car;
    let depth = p.z.max(MIN_DEPTH_M);
    let projection =
        Matrix2x3::new(1.0, 0.0, -p.x / depth, 0.0, 1.0, -p.y / depth) * (frame.focal_px / depth);
    let mut spread = projection * frame.camera_from_car;
    for axis in 0..3 {
        spread.column_mut(axis).scale_mut(sd_m[axis]);
    }
    spread * spread.transpose()
}
