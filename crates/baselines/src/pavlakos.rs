//! The method of Pavlakos et al. 2017. It solves weak perspective by a convex relaxation, and then full perspective.
//!
//! The points of a car are `S = B₀ + Σ c_i B_i` with shape coefficients c (Eq. 1). In this code, B₀ is the mean shape
//! of the shape atlas, and the B_i are its modes. The method minimises `½ ‖ξ(θ) D^½‖² + λ/2 ‖c‖²` over the unknowns θ
//! (Eq. 2). D is the diagonal matrix of the keypoints' confidences. The residual ξ has one of two forms:
//!
//! ```text
//! W − s R̄ S − t 1ᵀ           weak perspective (Eq. 4), W the image points
//! W̃ Z − R S − T 1ᵀ           full perspective (Eq. 5), W̃ the viewing rays, Z their depths
//! ```
//!
//! R is the rotation of the car, and R̄ are the first two rows of a rotation. T and t are translations, and s is a
//! scale.
//!
//! Weak perspective has a convex relaxation (`relaxation.rs`). Its solution is the initial value of a block coordinate
//! descent. The rotation and scale of weak perspective are the initial values for full perspective.
//!
//! Pavlakos et al. set λ by hand. Here λ follows from the prior c ~ N(0, I) of the atlas, and from an assumed sd of a
//! keypoint on the car, [`KEYPOINT_SD_M`](basis::KEYPOINT_SD_M).

mod basis;
mod full;
mod relaxation;
mod weak;

use roadplane_base::{Camera, KeypointSet, ShapeAtlas};

use crate::CarFit;
use crate::evidence::observations;
use basis::Basis;

pub use weak::WeakPerspective;

/// Fits the pose and shape of one car in front of a calibrated camera.
///
/// Returns `None` with fewer than five usable keypoints, or if the keypoints do not determine a pose (for example, if
/// all lie on a line).
#[must_use]
pub fn pavlakos(atlas: &ShapeAtlas, camera: &Camera, keypoints: &KeypointSet) -> Option<CarFit> {
    let observations = observations(camera, keypoints)?;
    let basis = Basis::new(atlas, &observations);
    let start = weak::solve(&basis, &observations)?;
    full::solve(&basis, &observations, &start)
}

/// Fits the rotation, scale and shape of one car under weak perspective. This is the first step of [`pavlakos`].
///
/// Returns `None` with fewer than five usable keypoints, or if the keypoints do not determine a pose.
#[must_use]
pub fn weak_perspective(
    atlas: &ShapeAtlas,
    camera: &Camera,
    keypoints: &KeypointSet,
) -> Option<WeakPerspective> {
    let observations = observations(camera, keypoints)?;
    weak::solve(&Basis::new(atlas, &observations), &observations)
}
