//! Pavlakos et al. 2017: weak perspective by convex relaxation, then full perspective.
//!
//! Their deformable shape is `S = B₀ + Σ c_i B_i` (Eq. 1; our atlas) and their problem `min ½ ‖ξ(θ) D^½‖² + λ/2 ‖c‖²`
//! (Eq. 2) with D the keypoints' confidences and ξ either of
//!
//! ```text
//! W − s R̄ S − t 1ᵀ           weak perspective (Eq. 4), W the image points
//! W̃ Z − R S − T 1ᵀ           full perspective (Eq. 5), W̃ the viewing rays, Z their depths
//! ```
//!
//! The first has a convex relaxation (`relaxation.rs`), from which block coordinate descent goes on; its rotation and scale
//! start the second. Their λ is set by hand; here it is that of the posterior: the atlas has c ~ N(0, I), and keypoints are
//! taken to be off by [`KEYPOINT_SD_M`] on the car.

mod full;
mod relaxation;
mod weak;

use nalgebra::{Matrix3, Vector3};
use roadplane_base::{Camera, KeypointSet, MODES, Shape, ShapeAtlas};

use crate::CarFit;
use crate::evidence::{Sight, sights};

pub use weak::WeakPerspective;

/// sd of a keypoint on the car, m: about 3 % of a car's length.
const KEYPOINT_SD_M: f64 = 0.13;
/// Most rounds of block coordinate descent; their code has as many.
const MAX_ROUNDS: usize = 1000;
/// Descent ends when a round lowers the cost by a smaller share.
const COST_TOLERANCE: f64 = 1e-9;

/// Pose and shape of one car before a known camera. `None` with fewer than five usable keypoints, or if they determine no
/// pose (all on a line, say).
#[must_use]
pub fn pavlakos(atlas: &ShapeAtlas, camera: &Camera, keypoints: &KeypointSet) -> Option<CarFit> {
    let sights = sights(camera, keypoints)?;
    let basis = Basis::new(atlas, &sights);
    let start = weak::solve(&basis, &sights)?;
    full::solve(&basis, &sights, &start)
}

/// Its first half alone: rotation, scale and shape under weak perspective. `None` as in [`pavlakos`].
#[must_use]
pub fn weak_perspective(
    atlas: &ShapeAtlas,
    camera: &Camera,
    keypoints: &KeypointSet,
) -> Option<WeakPerspective> {
    let sights = sights(camera, keypoints)?;
    weak::solve(&Basis::new(atlas, &sights), &sights)
}

/// The shape basis at the keypoints that were seen, car frame, m.
struct Basis {
    /// B₀ by sight.
    mean: Vec<Vector3<f64>>,
    /// B_i by sight.
    modes: [Vec<Vector3<f64>>; MODES],
}

impl Basis {
    fn new(atlas: &ShapeAtlas, sights: &[Sight]) -> Self {
        Self {
            mean: sights.iter().map(|s| atlas.mean[s.index]).collect(),
            modes: std::array::from_fn(|j| sights.iter().map(|s| atlas.modes[j][s.index]).collect()),
        }
    }

    /// S.
    fn shape(&self, c: &Shape) -> Vec<Vector3<f64>> {
        let point = |i: usize| (0..MODES).fold(self.mean[i], |point, j| point + self.modes[j][i] * c[j]);
        (0..self.mean.len()).map(point).collect()
    }

    /// The basis with the weighted mean of every member taken out: what is left when the best translation is put in.
    fn centred(&self, sights: &[Sight]) -> Self {
        let centred = |points: &[Vector3<f64>]| {
            let mean = weighted_mean(points, sights);
            points.iter().map(|point| point - mean).collect()
        };
        Self { mean: centred(&self.mean), modes: self.modes.each_ref().map(|mode| centred(mode)) }
    }
}

/// Mean of points by the sights' confidences.
fn weighted_mean(points: &[Vector3<f64>], sights: &[Sight]) -> Vector3<f64> {
    let total: f64 = sights.iter().map(|s| s.weight).sum();
    points.iter().zip(sights).map(|(point, s)| point * s.weight).sum::<Vector3<f64>>() / total
}

/// The rotation nearest to a matrix: `argmax tr(Rᵀ M)` (Procrustes; Umeyama 1991). `None` if M is not finite.
fn nearest_rotation(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    if !m.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = m.try_svd(true, true, f64::EPSILON, 200)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    Some(u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t)
}
