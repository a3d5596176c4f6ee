//! Keypoints in the form that the solver uses: undistorted, relative to the principal point, whitened and weighted.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use roadplane_base::{Camera, KEYPOINTS, Keypoint, KeypointSet, MIN_KEYPOINTS};

use crate::model::pose::{CarFrame, MIN_DEPTH_M};

/// Lower limit of a keypoint's score. A hidden keypoint has a large sd, but still some information.
const MIN_SCORE: f64 = 0.05;

/// Lower limit of a keypoint's standard deviation, px. It keeps the arithmetic stable.
const MIN_SD_PX: f64 = 1e-6;

/// A measured keypoint of a car in one frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observation {
    /// Index of the keypoint among all keypoints of a car.
    pub index: usize,
    /// Undistorted position, px from the principal point.
    pub pixel: Vector2<f64>,
    /// Derivative of `pixel` with respect to the lens distortion (1/px²), px³.
    pub by_lens: Vector2<f64>,
    /// Measured covariance of `pixel`, px².
    pub covariance: Matrix2<f64>,
    /// Weight of the keypoint in the cost: its score multiplied by the weight of the view.
    pub weight: f64,
    /// Entries (w00, w10, w11) of the lower triangular whitening matrix W, for which `Wᵀ W` is the inverse covariance.
    pub whitening: [f64; 3],
}

impl Observation {
    /// Returns the product `W v` of the whitening matrix and a vector.
    #[inline]
    pub fn whiten(&self, v: [f64; 2]) -> [f64; 2] {
        let [w00, w10, w11] = self.whitening;
        [w00 * v[0], w10 * v[0] + w11 * v[1]]
    }

    /// Sets the whitening matrix from the measured covariance plus an `extra` covariance (px²).
    pub fn whiten_with(&mut self, extra: &Matrix2<f64>) {
        let c = self.covariance + extra;
        let l00 = c[(0, 0)].max(MIN_SD_PX * MIN_SD_PX).sqrt();
        let l10 = c[(0, 1)] / l00;
        let l11 = (c[(1, 1)] - l10 * l10).max(MIN_SD_PX * MIN_SD_PX).sqrt();
        self.whitening = [1.0 / l00, -l10 / (l00 * l11), 1.0 / l11];
    }
}

/// Returns the usable keypoints of a car. They are finite, with a finite score and a positive definite covariance.
///
/// Returns `None` if there are fewer than [`MIN_KEYPOINTS`]. Of the camera, only the lens distortion and the principal
/// point are used.
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

/// Updates the whitening of a view's keypoints.
///
/// Three covariances add up: the measured covariance, the covariance of the shape atlas' residual, and that of an extra
/// error. The residual is the part of a keypoint's 3D position that the shape modes do not explain. Its sd is `scale` ×
/// `sd_m` for each keypoint, and it is projected at the keypoints of the `mean` car. The extra error has the sd
/// `extra_px` in both image directions.
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

/// Returns the covariance in the image, px², of an error of a 3D point of the car.
///
/// `sd_m` is the sd of the error along the car's axes. The covariance is
///
/// ```text
/// A diag(sd²) Aᵀ,   A = (f/z) [1 0 −x; 0 1 −y] R
/// ```
///
/// Here f is the focal length, z the depth, (x, y) the point's pixel divided by f, and R the car's rotation.
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
