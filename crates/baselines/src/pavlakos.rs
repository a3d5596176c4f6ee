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
//! taken to be off by [`KEYPOINT_SD_M`](basis::KEYPOINT_SD_M) on the car.

mod basis;
mod full;
mod relaxation;
mod weak;

use roadplane_base::{Camera, KeypointSet, ShapeAtlas};

use crate::CarFit;
use crate::evidence::observations;
use basis::Basis;

pub use weak::WeakPerspective;

/// Pose and shape of one car before a known camera. `None` with fewer than five usable keypoints, or if they determine no
/// pose (all on a line, say).
#[must_use]
pub fn pavlakos(atlas: &ShapeAtlas, camera: &Camera, keypoints: &KeypointSet) -> Option<CarFit> {
    let observations = observations(camera, keypoints)?;
    let basis = Basis::new(atlas, &observations);
    let start = weak::solve(&basis, &observations)?;
    full::solve(&basis, &observations, &start)
}

/// Its first half alone: rotation, scale and shape under weak perspective. `None` as in [`pavlakos`].
#[must_use]
pub fn weak_perspective(
    atlas: &ShapeAtlas,
    camera: &Camera,
    keypoints: &KeypointSet,
) -> Option<WeakPerspective> {
    let observations = observations(camera, keypoints)?;
    weak::solve(&Basis::new(atlas, &observations), &observations)
}
