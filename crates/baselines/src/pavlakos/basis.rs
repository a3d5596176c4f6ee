//! Parts that both steps use: the shape basis, weighted means, the nearest rotation, and the end of the descent.

use nalgebra::{Matrix3, Vector3};
use roadplane_base::{MODES, Shape, ShapeAtlas};

use crate::evidence::Observation;

/// sd of a keypoint on the car, m: about 3 % of a car's length.
pub(super) const KEYPOINT_SD_M: f64 = 0.13;
/// Most rounds of block coordinate descent, as in their code.
pub(super) const MAX_ROUNDS: usize = 1000;
/// The descent ends when the relative decrease of the cost in a round is smaller.
pub(super) const COST_TOLERANCE: f64 = 1e-9;

/// The shape basis at the observed keypoints, car frame, m.
pub(super) struct Basis {
    /// B₀, by observation.
    pub mean: Vec<Vector3<f64>>,
    /// B_i, by observation.
    pub modes: [Vec<Vector3<f64>>; MODES],
}

impl Basis {
    pub fn new(atlas: &ShapeAtlas, observations: &[Observation]) -> Self {
        Self {
            mean: observations.iter().map(|s| atlas.mean[s.index]).collect(),
            modes: std::array::from_fn(|j| observations.iter().map(|s| atlas.modes[j][s.index]).collect()),
        }
    }

    /// Returns S, the points of the shape with coefficients `c`, car frame, m.
    pub fn shape(&self, c: &Shape) -> Vec<Vector3<f64>> {
        let point = |i: usize| (0..MODES).fold(self.mean[i], |point, j| point + self.modes[j][i] * c[j]);
        (0..self.mean.len()).map(point).collect()
    }

    /// Returns the basis with the weighted mean of every member subtracted. It is the basis of the problem with the
    /// best translation substituted.
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

/// Returns the rotation nearest to a matrix: `argmax tr(Rᵀ M)` (Procrustes; Umeyama 1991). Returns `None` if M is not
/// finite.
pub(super) fn nearest_rotation(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    if !m.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = m.try_svd(true, true, f64::EPSILON, 200)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    Some(u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t)
}
