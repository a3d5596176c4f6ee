//! Keypoints as the solver uses them: where a straight lens would show them, relative to the principal point, whitened, weighted.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use roadplane_base::{Camera, KEYPOINTS, Keypoint, KeypointSet, MIN_KEYPOINTS};

use crate::model::pose::{CarFrame, MIN_DEPTH_M};

/// Scores below count as this: a hidden keypoint still says a little, with the wide sd that it comes with.
const MIN_SCORE: f64 = 0.05;

/// Smallest sd of a keypoint, px: no measurement is better, and the arithmetic stays sane.
const MIN_SD_PX: f64 = 1e-6;

/// A located keypoint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observation {
    /// Index of the keypoint.
    pub index: usize,
    /// Where a straight lens would show it, px from the principal point.
    pub pixel: Vector2<f64>,
    /// Its derivative by the lens' bend (1/px²), px³.
    pub by_lens: Vector2<f64>,
    /// Measured covariance, straightened, px².
    pub covariance: Matrix2<f64>,
    /// The paper's `s_i` (Eq. 6): score × weight of the view.
    pub weight: f64,
    /// Lower triangle (w00, w10, w11) of W with `Wᵀ W = Σ⁻¹`.
    pub whitening: [f64; 3],
}

impl Observation {
    /// `W v`.
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

/// The usable keypoints of a car: finite, with a positive definite covariance and a score in 0…1; `None` with fewer than
/// [`MIN_KEYPOINTS`]. Of the camera lens and principal point count.
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
        let bent = p.pixel - camera.principal_point_px;
        let straightening = camera.lens.straightening(&bent);
        let mut observation = Observation {
            index,
            pixel: camera.lens.straightened(&bent),
            by_lens: camera.lens.straightened_by_bend(&bent),
            covariance: straightening * p.covariance_px2 * straightening.transpose(),
            weight: p.score.clamp(MIN_SCORE, 1.0) * view_weight,
            whitening: [1.0, 0.0, 1.0],
        };
        observation.whiten_with(&Matrix2::zeros());
        Some(observation)
    };
    let found: Vec<Observation> = keypoints.iter().enumerate().filter_map(observation).collect();
    (found.len() >= MIN_KEYPOINTS).then_some(found)
}

/// Whitens a view's observations with their measured covariances, what the atlas leaves unexplained at each (`scale` × `sd_m`,
/// by keypoint; `mean` is where they are in the mean car) and `extra_px` in both directions.
pub(crate) fn whiten_seen<const N: usize>(
    observations: &mut [Observation],
    frame: &CarFrame<N>,
    mean: &[Vector3<f64>; KEYPOINTS],
    sd_m: &[Vector3<f64>; KEYPOINTS],
    scale: f64,
    extra_px: f64,
) {
    for observation in observations {
        let index = observation.index;
        let mut extra = unexplained_covariance(frame, &mean[index], &(sd_m[index] * scale));
        extra[(0, 0)] += extra_px * extra_px;
        extra[(1, 1)] += extra_px * extra_px;
        observation.whiten_with(&extra);
    }
}

/// What the atlas leaves unexplained at a point of the car (sd per axis of the car), seen from the camera: `A diag(sd²) Aᵀ`
/// with `A = (f/z) [1 0 −x; 0 1 −y] R`, px².
fn unexplained_covariance<const N: usize>(
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
