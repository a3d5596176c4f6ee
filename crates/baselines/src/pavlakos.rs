//! Pavlakos et al. 2017: weak perspective by convex relaxation, then full perspective.
//!
//! Their deformable shape is `S = B₀ + Σ c_i B_i` (Eq. 1; our atlas), and their problem is `min ½ ‖ξ(θ) D^½‖² + λ/2
//! ‖c‖²` (Eq. 2). D are the keypoints' confidences, and ξ is either of
//!
//! ```text
//! W − s R̄ S − t 1ᵀ           weak perspective (Eq. 4), W the image points
//! W̃ Z − R S − T 1ᵀ           full perspective (Eq. 5), W̃ the viewing rays, Z their depths
//! ```
//!
//! The first one has a convex relaxation (`relaxation.rs`), which starts a block coordinate descent. Its rotation and
//! scale start the second one. They set λ by hand. Here it is that of the posterior: the atlas has c ~ N(0, I), and a
//! keypoint's sd on the car is assumed to be [`KEYPOINT_SD_M`](basis::KEYPOINT_SD_M).

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
/// Returns `None` with fewer than five usable keypoints, or if they determine no pose (if all lie on a line, for
/// example).
#[must_use]
pub fn pavlakos(atlas: &ShapeAtlas, camera: &Camera, keypoints: &KeypointSet) -> Option<CarFit> {
    let observations = observations(camera, keypoints)?;
    let basis = Basis::new(atlas, &observations);
    let start = weak::solve(&basis, &observations)?;
    full::solve(&basis, &observations, &start)
}

/// Fits rotation, scale and shape under weak perspective: the first step of [`pavlakos`]. Returns `None` in the same
/// cases.
#[must_use]
pub fn weak_perspective(
    atlas: &ShapeAtlas,
    camera: &Camera,
    keypoints: &KeypointSet,
) -> Option<WeakPerspective> {
    let observations = observations(camera, keypoints)?;
    weak::solve(&Basis::new(atlas, &observations), &observations)
}
