//! Parts that weak and full perspective share: the shape basis, weighted means, the nearest rotation, and the limits of
//! the descent.

use nalgebra::{Matrix3, Vector3};
use roadplane_base::{MODES, Shape, ShapeAtlas};

use crate::evidence::Observation;

/// Sd of a keypoint on the car, m: about 3 % of a car's length.
pub(super) const KEYPOINT_SD_M: f64 = 0.13;
/// Largest number of rounds of block coordinate descent, as in the code of Pavlakos et al.
pub(super) const MAX_ROUNDS: usize = 1000;
/// The descent ends when a round lowers the cost by less than this share of it.
pub(super) const COST_TOLERANCE: f64 = 1e-9;

/// The shape basis at the observed keypoints, car frame, m.
pub(super) struct Basis {
    /// Mean shape B₀: one point per observation.
    pub mean: Vec<Vector3<f64>>,
    /// Modes B_i of the shape: each mode has one vector per observation.
    pub modes: [Vec<Vector3<f64>>; MODES],
}

impl Basis {
    pub fn new(atlas: &ShapeAtlas, observations: &[Observation]) -> Self {
        Self {
            mean: observations.iter().map(|s| atlas.mean[s.index]).collect(),
            modes: std::array::from_fn(|j| observations.iter().map(|s| atlas.modes[j][s.index]).collect()),
        }
    }

    /// Returns the points S of the shape with the coefficients `c`, car frame, m. There is one point per observation.
    pub fn shape(&self, c: &Shape) -> Vec<Vector3<f64>> {
        let point = |i: usize| (0..MODES).fold(self.mean[i], |point, j| point + self.modes[j][i] * c[j]);
        (0..self.mean.len()).map(point).collect()
    }

    /// Returns a basis without translation: the weighted mean is subtracted from the mean shape and from each mode. A
    /// problem with this basis need not contain the translation.
    pub fn centred(&self, observations: &[Observation]) -> Self {
        let centred = |points: &[Vector3<f64>]| {
            let mean = weighted_mean(points, observations);
            points.iter().map(|point| point - mean).collect()
        };
        Self { mean: centred(&self.mean), modes: self.modes.each_ref().map(|mode| centred(mode)) }
    }
}

/// Returns the mean of points, weighted by the observations' confidences.
pub(super) fn weighted_mean(points: &[Vector3<f64>], observations: &[Observation]) -> Vector3<f64> {
    let total: f64 = observations.iter().map(|s| s.weight).sum();
    points.iter().zip(observations).map(|(point, s)| point * s.weight).sum::<Vector3<f64>>() / total
}

/// Returns the rotation R nearest to a matrix M: `argmax tr(Rᵀ M)` (Procrustes; Umeyama 1991). Returns `None` if M is
/// not finite.
pub(super) fn nearest_rotation(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    if !m.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = m.try_svd(true, true, f64::EPSILON, 200)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    Some(u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t)
}
