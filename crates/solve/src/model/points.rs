//! The shape atlas in the form that the inner loop reads: all modes of one keypoint side by side.

use nalgebra::{SVector, Vector3};
use roadplane_base::{ALL_MODES, KEYPOINTS, MODES, ShapeAtlas};

/// Number by which the residual sd is multiplied in the model with all modes.
///
/// The two sides of a car, and all its views, share the same residual. But the solver treats keypoints as independent,
/// so it needs a larger sd. The number was measured on cars of makes that are not in the atlas.
const SHARED: f64 = std::f64::consts::SQRT_2;

/// Model of a car's keypoints: the mean car plus a weighted sum of M shape modes.
#[derive(Clone, Debug)]
pub(crate) struct PointModes<const M: usize = MODES> {
    pub mean: [Vector3<f64>; KEYPOINTS],
    pub modes: [[Vector3<f64>; M]; KEYPOINTS],
    /// Lowest and highest value of each coefficient.
    pub bounds: [[f64; 2]; M],
    /// Standard deviation of the residual that these modes do not explain, m along the car's axes.
    pub residual_sd_m: [Vector3<f64>; KEYPOINTS],
}

impl PointModes<MODES> {
    /// Creates the model with the first modes of the atlas; the coefficients have the atlas' bounds.
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
    /// Creates the model with all modes of the atlas; the coefficients have no bounds, because their prior limits them.
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
    /// Returns the position of a keypoint on a car of this shape, in the car frame, m.
    #[inline]
    pub fn point(&self, index: usize, shape: &SVector<f64, M>) -> Vector3<f64> {
        let mut point = self.mean[index];
        for (mode, coefficient) in self.modes[index].iter().zip(shape.iter()) {
            point += mode * *coefficient;
        }
        point
    }
}
