//! The second plane of a site whose ground has a fold.

use roadplane_base::{CameraEstimate, Ground, GroundPlane};
use roadplane_calibrate::Fold;

/// The plane of the ground beyond a fold.
#[derive(Clone, Debug)]
pub struct SecondPlane {
    /// The camera above this plane. Its focal length is that above the first plane.
    pub camera: CameraEstimate,
    /// Whether the ground lies above the first plane beyond the fold.
    pub rises: bool,
}

impl SecondPlane {
    /// Takes the second plane out of the estimates. Returns `None` if the camera has several estimates, or if the planes
    /// do not divide the picture like the fold.
    pub(super) fn take(
        fold: &Fold,
        estimates: &mut Vec<CameraEstimate>,
        segments: &mut Vec<usize>,
    ) -> Option<Self> {
        if segments[..] != [0, 1] {
            return None;
        }
        segments.pop();
        let camera = estimates.pop()?;
        let first = estimates.first()?.params;
        let ray = |index: usize| fold.middles_px[index].push(first.focal_px());
        let inverse_distance =
            |plane: &GroundPlane, index: usize| -plane.normal_in_camera.dot(&ray(index)) / plane.height_m;
        let (near, far) = (first.plane(), camera.params.plane());
        let rises = inverse_distance(&far, 1) > inverse_distance(&near, 1);
        let found = Self { camera, rises };
        let ground = found.ground(&near);
        let is_divided = (0..2).all(|index| ground.part_of_ray(&ray(index)).index == index);
        is_divided.then_some(found)
    }

    /// Returns the ground, whose first plane is `first` in the camera frame.
    pub(crate) fn ground(&self, first: &GroundPlane) -> Ground {
        Ground::folded(*first, self.camera.params.plane(), self.rises).unwrap_or(Ground::plane(*first))
    }
}
